"""The height volume of the block: its levels, tiles, photographs and jobs."""
