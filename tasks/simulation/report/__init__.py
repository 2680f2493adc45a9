"""What is said of the simulation."""
