"""Numbers as a person writes them: as many digits as the uncertainty leaves."""

from __future__ import annotations

import math

_SMALLEST_PLACES = 6  # decimal places beyond which a number is written with an exponent


def digits(value: float, significant: int = 3) -> str:
    """A number to some significant digits, without an exponent where it can be helped."""
    if value == 0.0 or not math.isfinite(value):
        return "0" if value == 0.0 else "–"
    rounded = float(f"{value:.{significant - 1}e}")  # 0.997 to two digits is 1.0
    size = math.floor(math.log10(abs(rounded)))
    if -4 <= size <= _SMALLEST_PLACES:
        return f"{value:.{max(0, significant - 1 - size)}f}"
    return f"{value:.{significant - 1}e}"


def to_deviation(value: float, std: float) -> str:
    """A number to the second digit of its 1-sigma; to three digits where it has none."""
    if not (std > 0.0 and math.isfinite(std) and math.isfinite(value)):
        return digits(value)
    places = 1 - math.floor(math.log10(std))
    if places > _SMALLEST_PLACES:
        return digits(value)
    return f"{round(value, places):.{max(0, places)}f}"


def with_deviation(value: float, std: float) -> str:
    """A number and its 1-sigma, both to the second digit of that: "-1.451 +- 0.011"."""
    if not (std > 0.0 and math.isfinite(std)):
        return digits(value)
    return f"{to_deviation(value, std)} +- {to_deviation(std, std)}"
