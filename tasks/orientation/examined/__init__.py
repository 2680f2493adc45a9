"""What is counted and computed of a finished block for its report."""
