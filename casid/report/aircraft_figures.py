"""The aircraft file compared with flight: its numbers, and the flight envelope of the records."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from casid.acceptance.compared import named
from casid.diagnosis.document import Document
from casid.diagnosis.facts import Parameter
from casid.records.record import Record
from casid.report import looks
from casid.report.figure import WIDE, Axis, Curve, Figure, Note, Panel, Part, Picture, Rule, Span, in_rows, stacked
from casid.report.sections import ReportTable, where
from casid.report.words import channel_axis, channel_scale, digits
from casid.signals import SURFACES

_MOST = 36  # parameters drawn
_FURTHEST = 150.0  # per cent: what stands further off is drawn at the edge
_ROW = 0.21  # inches
_CONSISTENT = looks.Look(name="consistent", colour=looks.BLUE, dash="", marker="o", size=5.0)
_AGAINST = looks.Look(name="inconsistent", colour=looks.ORANGE, dash="", marker="D", size=5.0)


def contradicted_first(document: Document) -> Callable[[Parameter], int]:
    """Return a key for sorting numbers of the file: those that flight contradicts in their order, before all others."""
    rank = {one.parameter: k for k, one in enumerate(document.contradicted)}
    return lambda one: rank.get(one.name, len(rank))


def derivatives(document: Document) -> Picture | None:
    """Deviation of flight from the file in per cent, with its 1-sigma, contradicted numbers first; None where there is
    nothing to be drawn."""
    against = [one.parameter for one in document.contradicted]
    told = [
        one for one in document.parameters if one.flight.determined and one.a_priori and math.isfinite(one.flight.std)
    ]
    told.sort(key=lambda one: -abs(_deviation(one)))
    order = sorted(told, key=contradicted_first(document))[:_MOST]
    if not order:
        return None
    states = document.aircraft.relative_uncertainty if document.aircraft and document.coefficients else 0.0
    stated = 100.0 * (states or document.criteria.parts.tenth)
    of = document.source
    witness = document.witness
    parts: list[Part] = [
        Span(look=looks.Look(name=f"within {stated:.0f} %", colour=looks.GREY), low=-stated, high=stated),
        Rule(look=looks.Look(colour=looks.INK), at=0.0),
    ]
    for y, one in enumerate(order):
        parts += _beside(y, one, _AGAINST if one.name in against else _CONSISTENT)
    x = Axis(label=f"{witness} against the {of} [% of the {of}'s number]", low=-_FURTHEST, high=_FURTHEST)
    bold = where(one.name in against for one in order)
    worst = next((one for one in order if one.name in against), order[0])
    return Picture(
        name="derivatives",
        figure=in_rows(parts, x, [one.name for one in order], _ROW, bold),
        title=f"The numbers of the {of} beside {witness}",
        caption=(
            "Dots: estimates from the records alone, with ±1σ. Orange diamonds, names in bold: inconsistent with the "
            f"{of}. Grey: within {stated:.0f} %, the uncertainty "
            + (f"that the {of} states." if states else f"taken where a {of} states none.")
        ),
        alt=f"Deviation of {len(order)} numbers of the {of} from {witness}, in per cent; {len(against)} of the {of}'s "
        f"numbers are inconsistent with {witness}; first is {worst.name} with {_deviation(worst):+.0f} per cent.",
    )


def _beside(y: int, one: Parameter, look: looks.Look) -> list[Curve | Note]:
    """Return a dot with its 1-sigma, or at the edge an arrow with the number of what is too far off."""
    at = _deviation(one)
    if abs(at) > _FURTHEST:
        edge = math.copysign(_FURTHEST, at)
        arrow = replace(look, name="", marker=">" if at > 0 else "<", size=7.0)
        align, off = ("right", -8.0) if at > 0 else ("left", 8.0)
        text = f"{at:+.0f} %".replace("-", "−")
        return [
            Curve(look=arrow, x=np.array([edge]), y=np.array([float(y)])),
            Note(text=text, x=edge, y=y, align=align, offset=(off, 0.0)),
        ]
    wide = abs(100.0 * one.flight.std / one.a_priori)
    ends = np.array([max(at - wide, -_FURTHEST), min(at + wide, _FURTHEST)])
    line = replace(look, name="", dash="-", width=2.0, marker="")
    return [
        Curve(look=line, x=ends, y=np.array([y, y], dtype=float)),
        Curve(look=look, x=np.array([at]), y=np.array([float(y)])),
    ]


def _deviation(one: Parameter) -> float:
    """Return the deviation of flight from the file [%]."""
    return 100.0 * (one.flight.value / one.a_priori - 1.0)


_QUANTITIES = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "az", *SURFACES, "thrust", "altitude")
_PAIRS = (("V", "alpha"), ("beta", "alpha"), ("p", "r"), ("q", "az"), ("delta_a", "delta_r"), ("alpha", "delta_e"))
_POINTS = 250  # of a record in one panel
_OUTSIDE = 0.02  # part of the held-out samples beyond the fitted range that is told


def _records(document: Document) -> tuple[Sequence[Record], Sequence[Record]]:
    """Return the records as they were judged: fitted, and held out."""
    return document.refitted.records, document.held_out_refitted.records


def _all(records: Sequence[Record], name: str) -> np.ndarray:
    """Return all measurements of a channel, in the unit that a person reads."""
    some = [channel_scale(name)[0] * record[name] for record in records if name in record]
    values = np.concatenate(some) if some else np.zeros(0)
    return values[np.isfinite(values)]


def envelope_table(document: Document) -> ReportTable:
    """Ranges of what was flown, in fitted and in held-out records; what of the latter lies outside is marked."""
    fitted, held = _records(document)
    rows = []
    outside = []
    for name in _QUANTITIES:
        seen = _all(fitted, name)
        unseen = _all(held, name)
        if not len(seen):
            continue
        beyond = float(np.mean((unseen < seen.min()) | (unseen > seen.max()))) if len(unseen) else 0.0
        told = beyond > _OUTSIDE
        row = {
            "quantity": f"{named(name)} [{channel_scale(name)[1]}]",
            "fitted records": _range(seen),
            "held-out records": _range(unseen) if len(unseen) else "–",
            "held out, beyond the fitted range": f"{100.0 * beyond:.0f} % of its samples" if told else "–",
        }
        rows.append(row)
        outside.append(told)
    caption = "The verdict and the values hold for what was flown. Beyond these ranges they are an extrapolation."
    return ReportTable.of(rows, caption, marked=where(outside))


def _range(values: np.ndarray) -> str:
    low = float(values.min())
    high = float(values.max())
    places = 3 if max(abs(low), abs(high)) < 1000.0 else 4
    return f"{digits(low, places)} to {digits(high, places)}"


def envelope(document: Document) -> Picture | None:
    """Pairs of quantities as they were flown; None where no pair was measured."""
    fitted, held = _records(document)
    pairs = [pair for pair in _PAIRS if all(any(name in r for r in fitted) for name in pair)]
    if not pairs:
        return None
    panels = [_pair(across, up, fitted, held) for across, up in pairs]
    return Picture(
        name="envelope",
        figure=Figure(rows=stacked(panels, 3), width=WIDE, linked=False),
        title="What was flown",
        caption="Every dot is a sample. A model that holds inside the blue cloud is an extrapolation outside of it.",
        alt=f"Scatter of {', '.join(f'{up} over {across}' for across, up in pairs)} in fitted and held-out records.",
    )


_FITTED = looks.Look(name="fitted", colour=looks.BLUE, dash="", marker="o", size=2.2, alpha=0.5)
_HELD_OUT = looks.Look(name="held out", colour=looks.ORANGE, dash="", marker="x", size=2.6, alpha=0.6)


def _pair(across: str, up: str, fitted: Sequence[Record], held: Sequence[Record]) -> Panel:
    """Return a cloud of one quantity over another."""
    curves = []
    for records, look in ((fitted, _FITTED), (held, _HELD_OUT)):
        for record in (r for r in records if across in r and up in r):
            thin = slice(None, None, -(-len(record) // _POINTS))
            x, y = (channel_scale(name)[0] * record[name][thin] for name in (across, up))
            curves.append(Curve(look=look, x=x, y=y))
    return Panel(parts=tuple(curves), x=Axis(label=channel_axis(across)), y=Axis(label=channel_axis(up)), height=1.7)
