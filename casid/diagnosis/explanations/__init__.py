"""What competes: explanations as wholes, weighed by one score."""
