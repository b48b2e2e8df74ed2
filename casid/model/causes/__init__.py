"""The causes: every way in which reality may differ from the aircraft file, each defined once, by where it enters."""

from casid.model.causes import aerodynamics, air, controls, equations, instruments, loading, recording, rotors, tables
from casid.model.effect import KINDS
