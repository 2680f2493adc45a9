"""Dense matching of epipolar pairs in blocks, each node on its own surface: what the surface model is made of."""
