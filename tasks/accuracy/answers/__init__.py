"""Answers that are read off a surface, each with its standard error: heights, profiles, areas, volumes."""
