"""What a block lets expect before anything is matched: how it was flown, how precise it can be, and what would make it better."""
