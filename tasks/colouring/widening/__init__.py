"""Next to the limits of what is hidden: where the zones lie in which colours serve only where there are no others."""
