"""Looks of what is drawn. Colours and names of what is measured, as given, extended, and of the noise are defined here
and nowhere else."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

# Okabe and Ito, Color Universal Design (2008)
INK = "#222222"
ORANGE = "#D55E00"
BLUE = "#0072B2"
GREEN = "#009E73"
PINK = "#CC79A7"
YELLOW = "#E69F00"
SKY = "#56B4E9"
GREY = "#DDDDDD"
FAINT = "#9A9A9A"


@dataclass(frozen=True, kw_only=True)
class Look:
    """Look of a part, and its name in the legend, "" for none."""

    colour: str
    name: str = ""
    width: float = 1.3
    dash: str = "-"  # "-", "--", "-.", ":", or "" for no line
    marker: str = ""  # "o", "s", "^", "D", "v", "P", "x", "<", ">", "."
    size: float = 4.0
    alpha: float = 1.0
    hatch: str = ""
    edge: str = ""

    def called(self, name: str) -> Look:
        """Return the look under another name in the legend."""
        return replace(self, name=name)


MEASURED = Look(name="measured", colour=INK, width=3.4, alpha=0.32)
SAMPLES = Look(name="samples", colour=FAINT, dash="", marker=".", size=1.8)
GIVEN = Look(name="as given", colour=ORANGE, dash="--")
EXTENDED = Look(name="extended", colour=BLUE)
INPUT = Look(name="recorded input", colour=GREEN, width=1.1)
EXPLAINED = Look(name="explained", colour=GREEN, dash="--")
NOISE = Look(name="±1σ noise of the instrument", colour=GREY)
DEVIATION = Look(name="±2σ", colour="#BBD7EA")
RIVAL = Look(colour=PINK, dash="--")
FAULT = Look(name="a fault", colour=PINK, alpha=0.35)
ZERO = Look(colour=FAINT, width=0.8)
LIMIT = Look(colour=INK, width=1.2, dash=":")
_MODELS = (GIVEN, EXTENDED, EXPLAINED.called(""), Look(colour=PINK, dash=":"), Look(colour=SKY), Look(colour=YELLOW))
_EACH = tuple(zip((BLUE, GREEN, PINK, YELLOW, SKY, ORANGE), "os^DvP", strict=True))


def of_models(models: Iterable[str], given: str | None = None) -> dict[str, Look]:
    """Return the looks of models by name: `given`, and else the first of several, is the simulation as given."""
    names = list(models)
    first = given if given is not None else names[0] if len(names) > 1 or names == [GIVEN.name] else None
    others = iter(_MODELS[1:] * len(names))
    return {name: (GIVEN if name == first else next(others)).called(name) for name in names}


def each(number: int, name: str = "") -> Look:
    """Return the look of one of several that are alike, such as records: dots in a colour and a shape of its own."""
    colour, marker = _EACH[number % len(_EACH)]
    return Look(name=name, colour=colour, dash="", marker=marker)
