"""Tasks on the disk, and the one who runs them: nothing that was acknowledged is lost with a process."""
