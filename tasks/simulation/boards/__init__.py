"""Simulated photographs of chessboards with known truth."""
