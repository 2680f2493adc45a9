"""Colours of a place from all photographs that see it, whatever surface it lies on: what `texture` and `projection` share.

A colour comes about in this order: the photographs that see the place (`sight`) and what each of them shows there (`sampling`), in
the radiometry of the block (`balance`), on the right side of a wall (`edges`), set back next to the limits of what is hidden
(`widening`), and all of them as one (`blending`).
"""
