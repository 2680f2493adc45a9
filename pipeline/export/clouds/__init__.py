"""Point clouds of a run in other systems and areas, and as octrees for viewers: LAZ, COPC, EPT."""
