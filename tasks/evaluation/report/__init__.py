"""What the stage `evaluation` tells of its comparisons."""
