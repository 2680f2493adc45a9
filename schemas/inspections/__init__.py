"""What is looked up in a single photograph, and by which rules."""
