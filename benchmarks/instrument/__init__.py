"""The instrument: what can be measured, the head of every page, and which pages are older than the code that they measure."""
