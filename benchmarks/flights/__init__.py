"""Simulated flights with everything that bends a block: whether it bends, and whether the program says so."""
