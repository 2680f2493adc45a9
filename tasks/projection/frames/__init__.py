"""Where the outputs lie in space."""
