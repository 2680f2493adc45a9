"""The interior orientation of the cameras: from a file, from EXIF, as given, or from photographs of chessboards."""
