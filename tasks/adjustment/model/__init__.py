"""The functional and stochastic model of a bundle: unknowns, observations, datum, and their linearisation."""
