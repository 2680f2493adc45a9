"""What the stage `densification` tells of its surface."""
