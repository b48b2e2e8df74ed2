"""Checks and words for `kind`, target and term of an effect, read from the register of causes.

The value of an effect is a difference from the aircraft file or from a perfect instrument, in SI; zero means that the
effect is absent (a rate limit is absent when it is infinite).
"""

from __future__ import annotations

import math
import re

from casid.errors import InputError, check_known, unknown
from casid.model.causes import KINDS
from casid.model.effect import Effect
from casid.model.rotors import ALL
from casid.model.terms import Term, derivative_name, in_words, parse_term
from casid.signals import label_of

LABELS = {
    "CL": "lift",
    "CD": "drag",
    "CY": "side force",
    "CX": "longitudinal force",
    "CZ": "normal force",
    "Cl": "rolling moment",
    "Cm": "pitching moment",
    "Cn": "yawing moment",
    "inertial": "inertial unit",
    "attitude": "attitude",
    "air_data": "air data",
    "surfaces": "surfaces",
    "external": "external pose",
    "ground": "motion over ground",
}


def check_effect(
    kind: str, target: str | None, term: str | None = None, where: str = "", *, anywhere: bool = False
) -> None:
    """Raise InputError, with the nearest valid name, unless kind, target (None or "": none) and term fit together:
    in an aircraft file, or `anywhere`, where a model says which ports it has."""
    prefix = f"{where}: " if where else ""
    check_known("effect kind", (kind,), KINDS, where)
    entry = KINDS[kind]
    of_a_port = anywhere and entry.place != "aircraft"
    if entry.place in ("equation", "value") and not anywhere:
        raise InputError(f"{prefix}effect '{kind}' is of a model of your own equations, not of an aircraft file")
    if not target and (entry.targets or entry.of_rotors or of_a_port) and not entry.optional:
        valid = (*entry.targets, *(("the name of a rotor", ALL) if entry.of_rotors else ()))
        raise InputError(f"{prefix}effect '{kind}' needs a target; expected one of: {', '.join(valid)}")
    if target and not entry.targets and not entry.of_rotors and not of_a_port:
        raise InputError(f"{prefix}effect '{kind}' has no target, got '{target}'; leave it out")
    parts = entry.parts(target)
    for part in parts:
        # which rotors there are an aircraft says, and which ports any other model
        if part not in entry.targets and not entry.of_rotors and not of_a_port:
            raise unknown(f"target of '{kind}'", part, entry.targets, where)
    if len(set(parts)) != len(parts):
        raise InputError(f"{prefix}effect '{kind}': target '{target}' names a coefficient twice")
    if entry.needs_term and not term:
        expected = f"one of: {', '.join(entry.terms)}" if entry.terms else "one like 'alpha^2'"
        raise InputError(f"{prefix}effect '{kind}' needs a term; expected {expected}")
    if term and not entry.needs_term:
        raise InputError(f"{prefix}effect '{kind}' has no term, got '{term}'; leave it out")
    if entry.terms and term not in entry.terms:
        raise unknown(f"term of '{kind}'", str(term), entry.terms, where)
    if term and not entry.terms and entry.place == "aircraft":
        parse_term(term, where)


def effect_unit(kind: str, target: str | None, term: str | None = None) -> str:
    """SI unit of the value of a valid effect, e.g. "s", "1/rad2"; raises InputError when it is not valid."""
    check_effect(kind, target, term, anywhere=True)
    return KINDS[kind].unit_for(target, term)


_EITHER = re.compile(r"\[([^|\]]*)\|([^\]]*)\]")  # words for a positive value, and for a negative one


def effect_sentence(kind: str, target: str | None, term: str | None, value: float) -> str:
    """Return what the effect means, for a person: size to two digits, angles in degrees; without a sign where the words
    give the direction. Raises InputError when not valid."""
    unit = effect_unit(kind, target, term)
    entry = KINDS[kind]
    label = " and ".join(_label(part) for part in entry.parts(target))
    sentence, value = _either(entry.sentence, value)
    percent = f"{_digits(100.0 * value)} %"
    first, told = _of_a_table((target or "").split("+")[0], term)
    comes = "come" if label.endswith("s") else "comes"
    words = {"label": label, "comes": comes, "term": told, "size": _size(value, unit), "percent": percent}
    return sentence.format(target=first, **words)


def effect_title(kind: str, target: str | None, term: str | None) -> str:
    """Short name of an effect for a person: "Cm: alpha^2", "elevator: actuator lag", "wind shear along x"."""
    words = kind.replace("_", " ").replace("cg ", "c.g. ")
    if not target:
        return words
    parts = KINDS[kind].parts(target)
    label = " and ".join(_label(part) for part in parts)
    said, told = _of_a_table(", ".join(parts), term)
    return KINDS[kind].title.format(words=words, label=label, target=said, term=told)


def _either(sentence: str, value: float) -> tuple[str, float]:
    """A template for the sign of a value, and the value, without its sign where the words state it."""
    chosen = _EITHER.sub(lambda words: words[1 if value >= 0.0 else 2], sentence)
    return chosen, value if chosen == sentence else abs(value)


def sentence_of(effect: Effect, value: float, std: float) -> str:
    """`effect_sentence` of any effect; at a port of a model it states the standard deviation of its size too."""
    if effect.unit_at_port is None:
        return effect_sentence(*effect.key, value)
    kind = KINDS[effect.kind]
    sentence, value = _either(kind.sentence, value)
    unit = "" if effect.unit == "1" else effect.unit
    size = f"{value:.4g} +- {std:.2g} {unit}".rstrip()
    percent = f"{100.0 * value:.3g} +- {100.0 * std:.2g} %"
    command = "equation of " if effect.states else "input "
    before = command if kind.place == "command" else ""
    return sentence.format(
        label=before + effect.target,
        comes="comes",
        target=effect.target,
        term=effect.term,
        size=size,
        percent=percent,
    )


def title_of(effect: Effect) -> str:
    """`effect_title` of any effect."""
    if effect.unit_at_port is None:
        return effect_title(*effect.key)
    return f"{effect.target}: {effect.kind.replace('_', ' ')} {effect.term or ''}".rstrip()


def _of_a_table(target: str, term: str | None) -> tuple[str, str | None]:
    """Target and term for a person; a stretch of a table of a derivative names the derivative: Cl_p at alpha 8 to
    14 deg."""
    if not term or "[" not in term:
        return target, term
    parsed = parse_term(term)
    stretches = Term(factors=(), stretches=parsed.stretches)
    first = derivative_name(target, Term(factors=parsed.factors)) if parsed.factors else target
    return first, in_words(stretches.name)


def _label(part: str) -> str:
    return LABELS.get(part, label_of(part))


def _digits(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.2g}"


def _size(value: float, unit: str) -> str:
    if unit.startswith("rad") and not unit.endswith("/rad"):
        value = math.degrees(value)
        unit = unit.replace("rad", "deg")
    return _digits(value) if unit == "1" else f"{_digits(value)} {unit}"
