"""What the stage `texture` tells of its orthoimage."""
