"""What the stage `calibration` tells of the cameras."""
