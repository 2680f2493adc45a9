"""Heights from pairs alone: every pair matched by a strategy that needs no volume, and the surface from their nodes."""
