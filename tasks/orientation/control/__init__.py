"""Ground control, check points and measured distances: read, carried into the project's system, intersected."""
