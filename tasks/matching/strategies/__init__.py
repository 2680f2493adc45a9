"""Many points together: cascade, pyramid without seeds, region growing; a part gives what the whole gives."""
