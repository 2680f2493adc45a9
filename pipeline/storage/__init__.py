"""Where pixels and tables are stored: rasters in zarr, tables next to them, photographs and maps as files."""
