"""The jobs of the stage `calibration`."""
