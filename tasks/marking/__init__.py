"""Marking points in photographs: where they should be seen, what their marks are worth, which of them is wrong."""
