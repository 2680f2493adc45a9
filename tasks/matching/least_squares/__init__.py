"""Least-squares matching of points: settings, kernels of both formulations, what is known of every match."""
