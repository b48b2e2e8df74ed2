"""The search for causes: choice of trials, acceptance gates, held-out records and probabilities."""
