"""What the tags of a photograph say of its position, its attitude and its camera, maker by maker."""
