"""Puts this folder on the path of its tests, which share `board_corners.py` and `drawn_boards.py`."""
