"""Water: the level of what is outlined, and what looks like water and is not."""
