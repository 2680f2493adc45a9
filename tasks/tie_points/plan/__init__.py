"""The jobs of the stage `tie_points`."""
