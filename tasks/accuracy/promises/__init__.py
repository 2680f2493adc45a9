"""Promised standard errors beside what independent observations found."""
