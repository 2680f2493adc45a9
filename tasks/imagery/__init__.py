"""Pixels without photogrammetry: radiometry, pyramids, resampling. Arrays in, arrays out."""
