"""The photogrammetry: shared numerics, one folder per stage above them, and the catalogue of stages."""

from pathlib import Path

from orthomill.tasks.kernel_cache import kernel_folder, use_kernel_cache

_ROOT = Path(__file__).parent.parent
use_kernel_cache(_ROOT, kernel_folder(_ROOT))

# numba reads where its cache is when it is imported.
from orthomill.tasks.kernel_compilation import share_kernels  # noqa: E402

share_kernels()
