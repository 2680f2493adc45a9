"""Normal equations and the iteration that minimises the residuals."""
