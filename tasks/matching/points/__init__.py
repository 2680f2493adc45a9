"""Interest points, their even distribution, and normalised correlation with matching back."""
