"""The adjusted block as tables and files that leave the stage."""
