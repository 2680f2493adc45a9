"""Least squares as surveyors know it: observations with weights, residuals, sigma0, redundancy, covariance; and the bundle."""
