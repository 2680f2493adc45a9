"""One colour from many."""
