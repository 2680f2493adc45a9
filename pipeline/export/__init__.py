"""The products: rasters as GeoTIFF, points as LAZ, tables as JSON and CSV."""
