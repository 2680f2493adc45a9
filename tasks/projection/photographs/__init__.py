"""Which photographs take part, which of their pixels, and what they prove of each other."""
