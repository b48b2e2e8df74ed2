"""E. Oezger, AIAA 2010-34: cases, truth, estimators, tables."""
