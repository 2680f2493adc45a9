"""What the node bears: kills, uploads, many tasks; with an engine that stands in for the pipeline."""
