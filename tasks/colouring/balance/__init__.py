"""One brightness for all photographs of a block."""
