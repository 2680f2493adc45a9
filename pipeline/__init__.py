"""The engine: from a workflow through jobs and Dask to zarr, products and the report. Knows no photogrammetry."""
