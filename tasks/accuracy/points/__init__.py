"""A product beside one surveyed point: the height of the surface there, and the place of the point in the orthoimage."""
