"""A simulated church entrance: columns, steps, an arch and a niche as a solid scene, and seven photographs of it."""
