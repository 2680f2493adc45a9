"""After the iteration: blunders, variance components, covariances and correlated image errors."""
