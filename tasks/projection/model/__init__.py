"""The coloured mesh to take away: charts and textures by block, coarser levels, files, and a page to look at it."""
