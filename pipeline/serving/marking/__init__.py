"""The page on which points are marked in photographs, and the files in which their marks are kept."""
