"""The stage `simulation`: photographs of scenes with known truth."""
