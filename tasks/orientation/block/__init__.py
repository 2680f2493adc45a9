"""What goes into one block adjustment, and what its residuals say of the cameras."""
