"""Blind tests: hidden effects, sealed answers, scores."""
