"""Rasters as colours: reduced, tinted, shaded; for the report and for maps."""
