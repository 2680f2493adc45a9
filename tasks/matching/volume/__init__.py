"""A semi-global optimisation over a volume of candidates: heights over map cells, or parallaxes of a pair."""
