"""Which points of a surface a photograph sees: pure functions of arrays."""
