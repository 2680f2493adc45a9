"""Findings of the stages that a reader must know, as codes with numbers; reports turn them into sentences."""
