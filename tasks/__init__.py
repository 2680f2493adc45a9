"""The photogrammetry: shared numerics, one folder per stage above them, and the catalogue of stages."""
