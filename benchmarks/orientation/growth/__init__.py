"""Growth of a run with its number of photographs: a rendered block, and what every stage takes for it."""
