"""The adjustment as an authority reads it: correlations, reliability, and covariances on request."""
