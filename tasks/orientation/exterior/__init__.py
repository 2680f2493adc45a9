"""Where the exterior orientation comes from: adjusted here, started from a file, or fixed as another program gave it."""
