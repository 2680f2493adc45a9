"""What is stated of accuracy: products tested at independent points, the promise of the errors, and what follows for a client."""
