"""What the stage `orientation` tells of the block."""
