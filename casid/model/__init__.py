"""Models: the aircraft file, its vocabulary, and the symbolic system made of it."""

from casid.model.aircraft import Aircraft, EffectValue, Inertia
from casid.model.terms import Term, derivative_name, derivative_term, parse_term
from casid.model.vocabulary import KINDS, Kind, check_effect, effect_sentence, effect_unit

__all__ = [
    "KINDS",
    "Aircraft",
    "EffectValue",
    "Inertia",
    "Kind",
    "Term",
    "check_effect",
    "derivative_name",
    "derivative_term",
    "effect_sentence",
    "effect_unit",
    "parse_term",
]
