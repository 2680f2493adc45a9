"""What the report says of a calibration from chessboards."""
