"""The engine: workflow to jobs to Dask to zarr, and what people read of it. Knows no photogrammetry."""
