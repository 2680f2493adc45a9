"""The jobs of the stage `texture`."""
