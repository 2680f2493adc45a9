"""Products as a map that opens in a browser, from the disk and without a network."""
