"""What is done next to the limits of what is hidden: the published zones, and how wide they are worth being."""
