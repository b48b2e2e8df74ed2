"""Analyse an estimation: intervals, and what the data can separate."""

from casid.analysis.bootstrap import Bootstrap, bootstrap, collected, drawn_problem, replica
from casid.analysis.identifiability import Identifiability, identifiability
from casid.analysis.profile import ProfileInterval, profile
