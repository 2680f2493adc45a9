"""What a check runs, and in which order: jobs, tables and rasters, no numerics."""
