"""What a run shows while it goes on: the map of its tiles, its progress, and how long it will still take."""
