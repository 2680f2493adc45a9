"""Straight edges of roofs and walls, measured in the photographs: places along them, their positions, and lines through them."""
