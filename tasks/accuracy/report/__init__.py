"""What the stage `accuracy` says, in words."""
