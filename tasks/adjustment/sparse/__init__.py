"""Symmetric block matrices: elimination order, Cholesky factors and the inverse on the pattern of the blocks."""
