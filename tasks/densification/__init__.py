"""The stage `densification`: dense matching of every pair, and the surface model."""
