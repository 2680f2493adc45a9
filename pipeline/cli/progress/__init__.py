"""What the terminal shows of a run: how it goes on, and how it ended."""
