"""Where pixels and tables are kept: rasters in zarr, tables beside them, photographs and maps as files."""
