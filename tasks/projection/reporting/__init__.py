"""What the report on the projections says of outputs and surfaces that are not what one expects."""
