"""Whether what is stated of accuracy holds."""
