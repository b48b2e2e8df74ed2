"""Numbers of an aircraft file with their unit in text, "6000 lb" or "3.2e4 slug ft2", as numbers in SI."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from casid.errors import InputError, nearest
from casid.signals import FOOT, POUND, SLUG, TONNE

INCH = FOOT / 12.0
# SI unit -> unit -> SI over number
UNITS: Mapping[str, Mapping[str, float]] = {
    "kg": {"kg": 1.0, "lb": POUND, "lbm": POUND, "slug": SLUG, "t": TONNE},
    "kg m2": {"kg m2": 1.0, "slug ft2": SLUG * FOOT**2, "lb ft2": POUND * FOOT**2, "lbm ft2": POUND * FOOT**2},
    "m": {"m": 1.0, "ft": FOOT, "in": INCH},
    "m2": {"m2": 1.0, "ft2": FOOT**2},
}
_NUMBER_AND_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*([A-Za-z].*?)\s*", re.ASCII)
_SPELLINGS = {"^": "", "**": "", "²": "2", "*": " ", "-": " ", "·": " ", "lbs": "lb", "slugs": "slug"}


def in_si(value: Any, si: str, what: str) -> Any:
    """A number of a file in SI: of a text with a unit its value, all else as it is.

    Parameters
    ----------
    value
        What stands in the file.
    si
        SI unit of the quantity: "kg", "kg m2", "m" or "m2".
    what
        Names it in an error.

    Raises
    ------
    InputError
        For a text that is no number with a unit of that quantity.
    """
    if not isinstance(value, str):
        return value
    number, unit = _parts(value)
    known = UNITS[si]
    if number is None or unit not in known:
        near = nearest(unit, known) if unit else None
        hint = f"did you mean '{near}'?" if near else f"expected a number, or one with a unit: {', '.join(known)}"
        raise InputError(f"{what} is the text '{value:.40}'; {hint}")
    return number * known[unit]


def as_written(value: float, like: str) -> str | None:
    """A number in SI as text in the unit of another text, and that text itself where it is the same number; None where
    the other is no number with a unit."""
    number, unit = _parts(like)
    factor = next((table[unit] for table in UNITS.values() if unit in table), None)
    if number is None or factor is None:
        return None
    return like if number * factor == value else f"{value / factor!r} {unit}"


def _parts(text: str) -> tuple[float | None, str]:
    """Number and unit of a text, spelled as in `UNITS`."""
    match = _NUMBER_AND_UNIT.fullmatch(text)
    if not match:
        return None, ""
    unit = match[2]
    for written, meant in _SPELLINGS.items():
        unit = unit.replace(written, meant)
    return float(match[1]), " ".join(unit.split())
