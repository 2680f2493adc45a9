"""Products in other programs."""
