"""Cameras that need no chessboards: from EXIF, from a file, typed in; and who took which photograph."""
