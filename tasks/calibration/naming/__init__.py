"""Identification: which board of one photograph is which board of another."""
