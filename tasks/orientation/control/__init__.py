"""Ground control, check points and measured distances: read, transformed to the project's system, intersected."""
