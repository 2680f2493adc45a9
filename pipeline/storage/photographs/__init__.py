"""Photographs as people have them: which files of a folder are photographs, and whether their pictures are whole."""
