"""The jobs of the stage `orientation`."""
