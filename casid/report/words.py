"""Numbers and causes as a person writes them."""

from __future__ import annotations

import math
import re

from casid.design.separation import NextFlight, Separation
from casid.model import numbers
from casid.model.effect import Effect
from casid.model.station import Station
from casid.model.terms import in_words
from casid.model.vocabulary import LABELS, title_of
from casid.signals import label_of, unit_of

_POWERS = str.maketrans("23456789", "²³⁴⁵⁶⁷⁸⁹")
EVIDENCE = (
    "The statistic is twice the natural logarithm of how many times more probable it makes the records: 14 is 1000 "
    "times."
)


def effect_name(effect: Effect) -> str:
    """Short name of an effect: "Cm: alpha²", "elevator: actuator lag", "wind shear along x"."""
    return pretty(title_of(effect))


def pretty(sentence: str) -> str:
    """Powers and units raised, products dotted, signs of numbers as long as a minus: "alpha^2*beta", "-1 m/s2"."""
    sentence = re.sub(r"(?<!\w)-(?=\d)", "−", sentence.replace("+-", "±"))
    raised = re.sub(r"\^([2-9])", lambda m: m[1].translate(_POWERS), re.sub(r"(?<=\w)\*(?=\w)", "·", sentence))
    return re.sub(r"(?<=/)(rad|deg|s|m)([23])\b", lambda m: m[1] + m[2].translate(_POWERS), raised)


def pretty_term(term: str) -> str:
    """ "alpha^2*beta" -> "alpha²·beta"; a stretch in words."""
    if "[" in term:
        return in_words(term)
    parts = [factor.partition("^") for factor in term.split("*")]
    return "·".join(name + power.translate(_POWERS) for name, _, power in parts)


def place(station: str) -> str:
    """Port of a latent input in words: "pitching moment Cm", "reading of beta"."""
    where = Station.at(station)
    if where.kind == "wind":
        return f"wind along {where.name}"
    if where.kind == "reading":
        return f"reading of {where.name}"
    return f"{LABELS.get(where.name, '')} {where.name}".strip()


def shown_unit(unit: str) -> tuple[float, str]:
    """Return (factor, unit) that a person reads: degrees for angles and what is made of them, SI for all else."""
    if unit.startswith("rad"):
        return math.degrees(1.0), "deg" + unit[3:].replace("s2", "s²")  # "rad/rad" is "deg/rad": the first alone
    return 1.0, unit.replace("s2", "s²").replace("m2", "m²").replace("m3", "m³").replace("rad2", "rad²").replace(
        "rad3", "rad³"
    )


def channel_scale(channel: str) -> tuple[float, str]:
    """Return (factor, unit) for showing a channel."""
    return shown_unit(unit_of(channel))


def channel_axis(channel: str) -> str:
    """Return the label of an axis of a channel with its unit, e.g. "q [deg/s]"."""
    unit = channel_scale(channel)[1]
    return f"{channel} [{unit}]" if unit else channel


def digits(value: float, significant: int = 3) -> str:
    """A number to some significant digits, without an exponent where it can be helped."""
    return numbers.digits(value, significant).replace("-", "−")


def quantity(value: float, unit: str, significant: int = 2) -> str:
    """A value with its unit as a person reads it; angles in degrees, pure ratios as they are."""
    factor, shown = shown_unit(unit)
    return _with_unit(digits(factor * value, significant), shown)


def with_std(value: float, std: float, unit: str) -> str:
    """Value ± 1-sigma with its unit, to two digits of the sigma."""
    factor, shown = shown_unit(unit)
    return _with_unit(numbers.with_deviation(factor * value, factor * std).replace("+-", "±").replace("-", "−"), shown)


def _with_unit(told: str, unit: str) -> str:
    return told if unit in ("", "1") else f"{told} {unit}"


def to_noise(value: float, std: float) -> str:
    """A number to the second digit of its 1-sigma."""
    return numbers.to_deviation(value, std).replace("-", "−")


def percent(value: float, of: float, std: float) -> str:
    """Format the deviation of one number, whose 1-sigma is given, from another: "−54.7 %"; a dash where that is
    zero."""
    if not of:
        return "–"
    told = numbers.to_deviation(100.0 * (value / of - 1.0), abs(100.0 * std / of))
    sign = "" if not told.strip("-0.") else "−" if told.startswith("-") else "+"
    return f"{sign}{told.removeprefix('-')} %"


def probability_in_words(probability: float) -> str:
    """Format a probability in per cent: never 0 or 100 of what is neither."""
    if probability > 0.995:
        return "> 99 %"
    return "< 1 %" if probability < 0.005 else f"{100.0 * probability:.0f} %"


def odds_in_words(found: Separation) -> str:
    """Describe how well a flight separates two causes, by the expected logarithm of their likelihood ratio."""
    log_odds = found.log_odds
    if not found.tells_apart:
        return "does not tell the two apart"
    if log_odds < math.log(20.0):
        return f"hints at one of the two, by odds of {math.exp(log_odds):.0f} to 1"
    if log_odds < math.log(1e6):
        return f"tells the two apart, by odds of {float(f'{math.exp(log_odds):.1g}'):,.0f} to 1".replace(",", " ")
    return "tells the two apart beyond any doubt, by odds of more than a million to 1"


def expectation_in_words(found: Separation) -> str:
    """Format the expected log likelihood ratio, and its scatter: "71 ± 12"."""
    return f"{digits(found.log_odds, 2)} ± {digits(found.scatter, 2)}"


def manoeuvre_in_words(found: NextFlight) -> str:
    """Describe a manoeuvre: "elevator: 3-2-1-1 with a shortest pulse of 0.40 s, ±1.6 deg from trim"."""
    size = quantity(found.amplitude, "rad")
    return f"{label_of(found.manoeuvre.surface)}: {found.manoeuvre.words}, ±{size} from trim"
