"""Clusters that a run starts itself, by a file that names their kind."""
