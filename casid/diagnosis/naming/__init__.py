"""Naming by rules: trials, events, what explains what is missing."""
