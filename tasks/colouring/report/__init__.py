"""What the reports of the stages which colour a surface say in the same words."""
