"""Points, lines and areas as files for maps and drawings."""
