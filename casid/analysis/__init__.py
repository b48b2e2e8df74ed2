"""Analyse an estimation: intervals, and what the data can separate."""

from casid.analysis.identifiability import Identifiability, identifiability
from casid.analysis.intervals import (
    Bootstrap,
    ProfileInterval,
    bootstrap,
    collected,
    drawn_problem,
    profile,
    replica,
)
