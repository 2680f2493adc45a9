"""Cameras that need no chessboards: from EXIF, from a file, typed in; and which camera took which photograph."""
