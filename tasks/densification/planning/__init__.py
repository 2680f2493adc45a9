"""The rasters and jobs of pairs and of the surface, whatever the heights come from."""
