"""Who minimises: Gauss-Newton, Newton, IPOPT, and the objective they share."""
