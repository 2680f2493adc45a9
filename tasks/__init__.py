"""The photogrammetry: shared numerics, one folder per stage above them, and the catalogue of stages."""

from pathlib import Path

from tasks.kernel_cache import use_kernel_cache

use_kernel_cache(sources=Path(__file__).parent, kept=Path(__file__).parent.parent / ".cache" / "kernels")
