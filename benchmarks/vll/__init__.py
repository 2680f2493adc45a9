"""The published study of vertical line locus on a simulated scene."""
