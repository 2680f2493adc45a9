"""The jobs of the stage `evaluation`."""
