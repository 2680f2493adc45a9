"""Vertical line locus: the height on a vertical line at which the photographs are most alike, node after node."""
