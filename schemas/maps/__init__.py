"""What PROJ knows of maps and heights, in the words of this program: scale, grids."""
