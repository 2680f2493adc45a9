"""Compiled kernels: the decorator that all rooms use, and where what it compiles is kept. Stands below everything."""
