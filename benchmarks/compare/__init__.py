"""Every method of densification on the same crops of finished runs."""
