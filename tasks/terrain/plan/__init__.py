"""The jobs of the stage `terrain`."""
