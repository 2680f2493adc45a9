"""The jobs of the stage `densification`."""
