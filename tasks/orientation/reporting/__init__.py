"""The parts of the block's report: tables, charts, maps and warnings."""
