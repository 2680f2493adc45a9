"""What a mesh costs before anything is projected: mending and cutting into blocks, in a process of its own for each size.

`python -m benchmarks mesh_growth` prints processor time and peak memory for a quarter, one and four million triangles.
These two jobs are the only ones, besides the coloured PLY, that hold a whole mesh.
"""

import resource
import subprocess
import sys
import time

from benchmarks.texture.texture_acceptance import sheet
from orthomill.schemas.solid.mesh import TriangleMesh
from orthomill.tasks.projection.mesh.depth_rasters import cut_into_blocks
from orthomill.tasks.projection.mesh.mesh_mending import mend_mesh

SIDES = (354, 708, 1415)
"""vertices along a side of the rough sheet"""


def measured(side: int) -> str:
    """A row of the table."""
    vertices, triangles = sheet(side)
    mesh, before, start = TriangleMesh(vertices, triangles), _peak(), time.process_time()
    mended = mend_mesh(mesh, "m", (0.0, 0.0, 0.0))
    between, middle = time.process_time(), _peak()
    cut_into_blocks(mended.vertices, mended.triangles)
    spent = between - start, time.process_time() - between
    return f"| {len(triangles)} | {spent[0]:.1f} | {spent[1]:.1f} | {before:.0f} | {middle:.0f} | {_peak():.0f} |"


def _peak() -> float:
    """MiB of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main(words: list[str]) -> None:
    """Measure each size in a process of its own: a peak never falls."""
    print("| triangles | mending CPU-s | cutting CPU-s | MiB with the mesh read | mended | cut |")
    print("| --- | --- | --- | --- | --- | --- |")
    for side in map(int, words or SIDES):
        command = [sys.executable, "-m", "benchmarks.texture.mesh_growth", str(side)]
        print(subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip(), flush=True)


if __name__ == "__main__":
    print(measured(int(sys.argv[1])))
