"""What the stage `dsm_check` tells of the surface under test."""
