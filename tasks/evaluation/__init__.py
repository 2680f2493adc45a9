"""The stage `evaluation`: results against the truth of a simulation, or against reference files."""
