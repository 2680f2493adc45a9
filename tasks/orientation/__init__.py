"""Stage `orientation`: relative orientation of pairs, then one block with control, positions and check points."""
