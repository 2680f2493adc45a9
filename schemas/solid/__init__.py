"""Surfaces that are no height models, and what they are projected onto."""
