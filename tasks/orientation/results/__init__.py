"""The adjusted block as tables and files."""
