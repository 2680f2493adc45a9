"""What people type: the command `orthomill` and what each of its words does."""
