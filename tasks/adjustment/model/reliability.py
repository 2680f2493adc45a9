"""Inner reliability: how large an error must be for a test of one observation to find it."""

# The noncentrality delta_0 of Baarda's B-method, for alpha_0 = 0.1 % and beta_0 = 80 %: 3.29 + 0.84.
NONCENTRALITY = 4.13
"""A test at 0.1 % finds a bias of this many standard errors with 80 % probability (Baarda 1968)."""
