"""The jobs of the stage `projection`: which tile reads what. No numerics beyond boxes and windows."""
