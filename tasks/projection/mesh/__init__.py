"""The mesh made ready: mended, cut into blocks, drawn into depth rasters."""
