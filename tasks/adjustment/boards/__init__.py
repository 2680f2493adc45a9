"""Self-calibrating bundle adjustment of photographs of chessboards."""
