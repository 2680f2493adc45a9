"""The map of a finished run, with what only the run knows of a place."""
