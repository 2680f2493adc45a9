"""The tags of image files, as text."""
