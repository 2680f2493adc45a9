"""What is said of the map."""
