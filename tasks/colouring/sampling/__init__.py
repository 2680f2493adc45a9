"""What a photograph shows at places of a surface: its colour, and what that is worth."""
