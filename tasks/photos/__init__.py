"""Reads the photographs: what their headers say, their pixels upright, and their pyramids."""
