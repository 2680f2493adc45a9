"""The products of a run as a map in a browser."""
