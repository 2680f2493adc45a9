"""The block in the system of a plane in space, so that a surface stands on a facade as it does on the ground."""
