"""What the report shows of a calibration from chessboards."""
