"""The jobs of the stage `photos`."""
