"""Numbers and causes as a person writes them."""

from __future__ import annotations

import math
import re
import textwrap

from casid.model.effect import Effect
from casid.model.station import Station
from casid.model.vocabulary import effect_title
from casid.report.style import shown_unit

_POWERS = str.maketrans("23456789", "²³⁴⁵⁶⁷⁸⁹")
_LABEL = 40  # characters
_COEFFICIENTS = {
    "CL": "lift",
    "CD": "drag",
    "CY": "side force",
    "CX": "longitudinal force",
    "CZ": "normal force",
    "Cl": "rolling moment",
    "Cm": "pitching moment",
    "Cn": "yawing moment",
}


def cause_name(kind: str, target: str | None, term: str | None) -> str:
    """Short name of a cause: "Cm: alpha²", "elevator: actuator lag", "wind shear along x"."""
    return effect_title(kind, target, pretty_term(term) if term else None)


def effect_name(effect: Effect) -> str:
    """Short name of an effect."""
    return cause_name(effect.kind, effect.target, effect.term)


def label(name: str) -> str:
    """A name beside an axis, in more than one line when it is long: what is left of the width is the figure's."""
    return textwrap.fill(name, _LABEL)


def pretty(sentence: str) -> str:
    """Powers and units raised, products dotted, signs of numbers as long as a minus: "alpha^2*beta", "-1 m/s2"."""
    sentence = re.sub(r"(?<!\w)-(?=\d)", "−", sentence.replace("+-", "±"))
    raised = re.sub(r"\^([2-9])", lambda m: m[1].translate(_POWERS), re.sub(r"(?<=\w)\*(?=\w)", "·", sentence))
    return re.sub(r"(?<=/)(rad|deg|s|m)([23])\b", lambda m: m[1] + m[2].translate(_POWERS), raised)


def pretty_term(term: str) -> str:
    """ "alpha^2*beta" -> "alpha²·beta"."""
    parts = [factor.partition("^") for factor in term.split("*")]
    return "·".join(name + power.translate(_POWERS) for name, _, power in parts)


def place(station: str) -> str:
    """Where an anonymous input enters, in words: "pitching moment Cm", "reading of beta"."""
    where = Station.at(station)
    if where.kind == "wind":
        return f"wind along {where.name}"
    if where.kind == "reading":
        return f"reading of {where.name}"
    return f"{_COEFFICIENTS.get(where.name, '')} {where.name}".strip()


def digits(value: float, significant: int = 3) -> str:
    """A number to some significant digits, without an exponent where it can be helped."""
    if value == 0.0 or not math.isfinite(value):
        return "0" if value == 0.0 else "–"
    size = math.floor(math.log10(abs(value)))
    if -4 <= size <= 6:
        return f"{value:.{max(0, significant - 1 - size)}f}".replace("-", "−")
    return f"{value:.{significant - 1}e}".replace("-", "−")


def quantity(value: float, unit: str, significant: int = 2) -> str:
    """A value with its unit as a person reads it; angles in degrees, pure ratios as they are."""
    factor, shown = shown_unit(unit)
    return f"{digits(factor * value, significant)} {shown}" if shown != "1" else digits(value, significant)


def with_std(value: float, std: float, unit: str) -> str:
    """Value ± 1-sigma with its unit, to two digits of the sigma."""
    factor, shown = shown_unit(unit)
    shown = "" if shown == "1" else f" {shown}"
    if not (std > 0.0 and math.isfinite(std)):
        return f"{digits(factor * value)}{shown}"
    places = max(0, 1 - math.floor(math.log10(factor * std)))
    if places > 6:
        return f"{digits(factor * value)} ± {digits(factor * std, 2)}{shown}"
    return f"{factor * value:.{places}f} ± {factor * std:.{places}f}{shown}".replace("-", "−")
