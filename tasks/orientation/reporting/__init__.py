"""The parts of the report of a block: figures, tables, charts, maps, warnings and the words for findings."""
