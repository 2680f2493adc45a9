"""Edges of buildings finer than a cell: near a wall every ortho pixel chooses the upper or the lower surface by the photographs."""
