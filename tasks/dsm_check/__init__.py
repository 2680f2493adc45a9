"""The stage `dsm_check`: the surface model checked without reference data."""
