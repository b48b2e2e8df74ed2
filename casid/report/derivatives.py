"""The numbers of the aircraft file beside flight: what the table says of each, and their picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

from casid.diagnosis.parameter import Parameter
from casid.diagnosis.result import Diagnosis
from casid.report.style import BASELINE, EXTENDED, FAINT, MEASURED, NOISE, Picture, blank, settings
from casid.report.words import digits, percent, with_std

_MOST = 36  # parameters drawn
_FURTHEST = 150.0  # per cent: what stands further off is drawn at the edge
_ROW = 0.21  # inches


@dataclass(frozen=True, kw_only=True)
class Compared:
    """A number of the file beside flight, in words, and whether flight stands `against` it."""

    name: str
    file: str
    flight: str
    deviation: str
    sigmas: str
    against: bool


def compared(diagnosis: Diagnosis) -> list[Compared]:
    """Every number of the file, those that flight contradicts first, and last what these records do not tell."""
    against = [one.parameter for one in diagnosis.contradicted]
    found = sorted(diagnosis.parameters, key=lambda one: (_rank(one.name, against), not one.flight.determined))
    return [_in_words(one, one.name in against) for one in found]


def _rank(name: str, against: list[str]) -> int:
    return against.index(name) if name in against else len(against)


def _in_words(one: Parameter, against: bool) -> Compared:
    says, given = one.flight, one.a_priori
    unit = "1" if one.unit.startswith("1/") else one.unit
    if not says.determined:
        return Compared(
            name=one.name,
            file=with_std(given, 0.0, unit),
            flight="not identifiable from these records",
            deviation="",
            sigmas="",
            against=False,
        )
    return Compared(
        name=one.name,
        file=with_std(given, 0.0, unit),
        flight=with_std(says.value, says.std, unit),
        deviation=percent(says.value, given, says.std),
        sigmas=digits(abs(says.value - given) / says.std, 2) if says.std > 0.0 else "–",
        against=against,
    )


def derivatives(diagnosis: Diagnosis) -> Picture | None:
    """Deviation of flight from the file in per cent, with its 1-sigma, contradicted numbers first; None where there is
    nothing to be drawn."""
    against = [one.parameter for one in diagnosis.contradicted]
    told = [
        one for one in diagnosis.parameters if one.flight.determined and one.a_priori and math.isfinite(one.flight.std)
    ]
    order = sorted(told, key=lambda one: (_rank(one.name, against), -abs(_deviation(one))))[:_MOST]
    if not order:
        return None
    with settings():
        figure = blank(_ROW * len(order) + 1.3)
        ax = figure.subplots()
        stated = 100.0 * (diagnosis.aircraft.relative_uncertainty or diagnosis.criteria.given.unstated)
        ax.axvspan(-stated, stated, color=NOISE, lw=0)
        ax.axvline(0.0, color=MEASURED, lw=1.0)
        for y, one in enumerate(order):
            at, wide = _deviation(one), abs(100.0 * one.flight.std / one.a_priori)
            colour = BASELINE if one.name in against else EXTENDED
            if abs(at) > _FURTHEST:
                edge = math.copysign(_FURTHEST, at)
                ax.plot(edge, y, ">" if at > 0 else "<", color=colour, ms=7, clip_on=False)
                ax.annotate(
                    f"{at:+.0f} %".replace("-", "−"),
                    (edge, y),
                    xytext=(-8 if at > 0 else 8, 0),
                    textcoords="offset points",
                    va="center",
                    ha="right" if at > 0 else "left",
                    fontsize=9,
                )
                continue
            ax.plot([max(at - wide, -_FURTHEST), min(at + wide, _FURTHEST)], [y, y], color=colour, lw=2)
            ax.plot(at, y, "D" if one.name in against else "o", color=colour, ms=5)
        ax.set_xlim(-_FURTHEST, _FURTHEST)
        ax.set_ylim(len(order) - 0.4, -0.6)
        ax.set_yticks(range(len(order)), [one.name for one in order])
        for label, one in zip(ax.get_yticklabels(), order, strict=True):
            label.set_fontweight("bold" if one.name in against else "normal")
        ax.grid(axis="y", color=FAINT, lw=0.3)
        ax.set_xlabel("flight against the file [% of the file's number]")
    worst = next((one for one in order if one.name in against), order[0])
    return Picture(
        name="derivatives",
        figure=figure,
        title="The numbers of the file beside flight",
        caption=(
            "Dots: estimates from the records alone, with ±1σ. Orange diamonds, names in bold: flight is "
            f"inconsistent with the file. Grey: within {stated:.0f} %, the uncertainty "
            + (
                "that the file states."
                if diagnosis.aircraft.relative_uncertainty
                else "taken where a file states none."
            )
        ),
        alt=f"Deviation of {len(order)} numbers of the file from flight, in per cent; {len(against)} of the file's "
        f"numbers are inconsistent with flight; first is {worst.name} with {_deviation(worst):+.0f} per cent.",
    )


def _deviation(one: Parameter) -> float:
    """Of flight from the file [%]."""
    return 100.0 * (one.flight.value / one.a_priori - 1.0)
