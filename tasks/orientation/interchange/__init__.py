"""Orientations of other programs, read and written: CSV of angles, COLMAP's text model, OpenSfM's and ODM's reconstruction.json."""
