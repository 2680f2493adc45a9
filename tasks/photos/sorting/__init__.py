"""Which photographs of a folder make one block, and by what names."""
