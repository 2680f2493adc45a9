"""Guided densification: points level by level, each searched where the model of the level before lets it lie, then every pixel."""
