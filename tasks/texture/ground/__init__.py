"""The ground under a tile of the orthoimage: which part of the surface model it needs, and heights where that has none."""
