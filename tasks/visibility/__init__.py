"""Which points of a surface a photograph sees. Arrays in, arrays out."""
