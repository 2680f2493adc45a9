"""Lines in which planes meet a solid surface."""
