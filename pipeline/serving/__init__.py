"""Pages that this machine serves to its own user: nothing here listens to anybody else, or loads anything from elsewhere."""
