"""The jobs of the stage `registration`."""
