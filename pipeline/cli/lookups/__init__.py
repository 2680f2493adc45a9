"""Questions to a finished run: where a point of a photograph is, how two photographs lie to each other."""
