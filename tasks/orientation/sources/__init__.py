"""What each source says about the block, which sources contradict each other, and the cause that explains it best."""
