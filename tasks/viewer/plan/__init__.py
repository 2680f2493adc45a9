"""The jobs of the stage `viewer`."""
