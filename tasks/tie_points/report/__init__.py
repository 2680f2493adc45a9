"""What the stage `tie_points` tells of how well the photographs are connected."""
