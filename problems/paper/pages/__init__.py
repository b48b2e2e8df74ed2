"""Pages and pictures of the paper's experiments."""
