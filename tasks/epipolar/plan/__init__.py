"""The jobs of the stage `epipolar`."""
