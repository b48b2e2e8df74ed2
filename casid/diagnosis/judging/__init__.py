"""Held-out records and the verdict."""
