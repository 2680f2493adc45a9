"""The engine: from a workflow through jobs and Dask to zarr, products and the report. Knows no photogrammetry.

Results must not depend on the number of cores: libraries that would divide a sum among threads get a single one, in this process
and in the workers that it starts.
"""

import os

# The libraries read these variables when they are loaded, so they are set in the first module that is imported.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"))
