"""What watching a run costs, and how well it foretells."""
