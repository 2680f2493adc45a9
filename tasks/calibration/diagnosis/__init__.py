"""What a calibration from chessboards is worth: weaknesses, distortion, residuals over the frame, what was left out."""
