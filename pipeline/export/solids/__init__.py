"""The surface with the orthoimage on it, for programs that show things in space."""
