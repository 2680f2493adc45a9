"""Jobs of the stage `accuracy`."""
