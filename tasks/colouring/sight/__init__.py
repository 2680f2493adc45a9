"""Which photographs see the pixels of an output of a mesh, and what a job on them has at hand."""
