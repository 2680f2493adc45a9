"""Points, lines and polygons that a user has drawn, from files of a GIS."""
