"""The engine: workflow to jobs to Dask to zarr, and what people read of it. Knows no photogrammetry.

Results must not hang on the number of cores: libraries that would split a sum among threads get a single one, in this process and
in the workers that it starts. It has to be said before any of them is loaded, hence here.
"""

import os

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"))
