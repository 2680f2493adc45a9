"""The simulated ground: its height model, materials, colours, and which photographs truly see it."""
