"""What the stage `photos` tells of the photographs."""
