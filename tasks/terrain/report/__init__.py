"""What is said of the terrain."""
