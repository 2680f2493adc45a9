"""Positions files of receivers, drones and programs: one reader for each format, matched to photographs, placed in the project."""
