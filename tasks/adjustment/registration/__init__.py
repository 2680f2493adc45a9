"""Joint registration of scans: rotation and translation of each, from control and the points that they share."""
