"""Deliveries held against what was agreed: clause by clause."""
