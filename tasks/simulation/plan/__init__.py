"""The jobs of the stage `simulation`."""
