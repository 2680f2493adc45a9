"""Which cells are ground, and the ground where none was measured."""
