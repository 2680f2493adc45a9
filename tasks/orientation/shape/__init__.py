"""Whether the block is bent, by what it was not adjusted to: the scatter of positions, and the attitudes of the photographs."""
