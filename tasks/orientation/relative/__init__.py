"""Relative orientation of pairs of photographs, each pair on its own."""
