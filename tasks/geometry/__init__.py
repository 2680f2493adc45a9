"""Rotations, collinearity, distortion, rays, intersection, epipolar geometry. Radians, metres, pixels; see docs/conventions.md."""
