"""The proof of match: its figures and its page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from casid.acceptance.checks import EXTENDED, GIVEN, MatchedTest, Side, compared_channels, span
from casid.acceptance.justification import Rationale, rationale_of
from casid.acceptance.proof import ProofOfMatch
from casid.acceptance.quantities import Quantity
from casid.acceptance.tolerances import Tolerance, told
from casid.diagnosis.document import NextStep
from casid.errors import unknown
from casid.records.channel_faults import stretches
from casid.report import looks
from casid.report.estimate_figures import file_name
from casid.report.figure import TIME, WIDE, Axis, Band, Curve, Figure, Panel, Part, Picture, Rule, Span, stacked
from casid.report.result_page import BAD, GOOD
from casid.report.sections import ReportTable, where
from casid.report.svg import shown
from casid.report.templating import drawn_into, render
from casid.report.words import channel_scale, digits, with_std
from casid.signals import SURFACES, label_of

_LINES = {GIVEN: looks.GIVEN, EXTENDED: looks.EXTENDED}
_FLIGHT = replace(looks.MEASURED, width=2.6, alpha=0.45)
_TOLERANCE = looks.Look(name="tolerance", colour=looks.GREY)
_SURFACES = {
    name: looks.Look(name=label_of(name), colour=colour, width=1.1)
    for name, colour in zip(SURFACES, (looks.GREEN, looks.PINK, looks.YELLOW), strict=True)
}
_CORRECTED = looks.Look(name="with corrections", colour=looks.INK, dash=":", width=1.0)
_DRIVEN = looks.Look(colour=looks.GREEN, width=1.1)
_BEGIN = looks.Look(colour=looks.FAINT, width=0.9, dash=":")
_DOTS = 250  # samples of a panel: an SVG of all of them takes longer and looks the same


def plot(proof: ProofOfMatch, test: str | None) -> Any:
    """Return the figure of the first test with this id, and without one of the first of all, for a notebook."""
    found = [one for one in proof.tests if test in (None, one.test.id)]
    if not found:
        raise unknown("test", str(test), {one.test.id for one in proof.tests}, "proof.plot")
    return shown(match_figure(found[0]).figure)


def match_figure(one: MatchedTest) -> Picture:
    """Return a panel for each compared channel, in the unit of its tolerance, and one for the inputs.

    Pale band: the tolerance about flight. A bar at the foot: where a simulation leaves it.
    """
    tolerances = {row.channel: row for row in one.test.tolerances if row.quantity is None}
    channels = [name for name in one.test.channels if name in one.flight.samples]
    panels = [*(_channel(one, name, tolerances.get(name)) for name in channels), _surfaces(one)]
    if one.test.manoeuvre == "power change":
        thrust = Curve(look=_DRIVEN, x=one.flight.t, y=1e-3 * _inside(one, "thrust"))
        panels.append(_panel(one, "thrust, driven", "kN", [thrust]))
    return Picture(
        name=_file(one),
        figure=Figure(rows=stacked(panels, 2), width=WIDE),
        title=f"{one.test.id} {one.test.title}",
        caption="Dots: flight as measured. Thick line: the same, its noise smoothed, which is compared. Pale band: the "
        "tolerance about it. Bars at the foot of a panel: where a simulation is out of tolerance. Dotted: where the "
        "manoeuvre begins.",
        alt=f"Time histories of {', '.join(map(told, channels))}: flight, tolerance band and simulation.",
    )


def _file(one: MatchedTest, of: str = "") -> str:
    return file_name(f"{one.test.id}_{one.record.name}_{one.window.start:.0f}s{of}")


def _panel(one: MatchedTest, name: str, unit: str, parts: Sequence[Part]) -> Panel:
    begin = Rule(look=_BEGIN, at=one.window.begin)
    return Panel(parts=(*parts, begin), x=TIME, y=Axis(label=f"{name} [{unit}]" if unit else name))


def _channel(one: MatchedTest, name: str, row: Tolerance | None) -> Panel:
    """Return a channel in the unit of the tolerance of its time history; without one, in that which people read."""
    factor, unit = channel_scale(name) if row is None else (1.0 / row.factor, row.unit)
    t = one.flight.t
    curve = one.flight.curves[name]
    inside = np.zeros(len(t), dtype=bool)
    limit = np.zeros(len(t))
    parts: list[Part] = []
    if row is not None:
        inside = span(row, t, one.window)
        limit = np.broadcast_to(row.limit(curve, float(np.abs(curve[inside]).max(initial=0.0))), curve.shape)
        low, high = (factor * (curve + side * limit)[inside] for side in (-1.0, 1.0))
        parts.append(Band(look=_TOLERANCE, x=t[inside], low=low, high=high))
    parts.append(_dots(t, factor * one.flight.samples[name]))
    parts.append(Curve(look=_FLIGHT, x=t, y=factor * curve))
    for place, (label, side) in enumerate(one.sides.items()):
        simulated = compared_channels(side.flown, one.record, one.window, (name,)).get(name)
        if simulated is None:
            continue
        parts.append(Curve(look=_LINES[label], x=t, y=factor * simulated))
        foot = 0.012 + 0.03 * place
        at_the_foot = replace(_LINES[label], name="")
        for first, last in stretches(inside & (np.abs(simulated - curve) > limit)):
            parts.append(Span(look=at_the_foot, low=float(t[first]), high=float(t[last]), part=(foot, foot + 0.024)))
    return _panel(one, told(name), unit, parts)


def _dots(t: np.ndarray, y: np.ndarray) -> Curve:
    """Return the samples, thinned to what can be told apart."""
    every = -(-len(t) // _DOTS)
    return Curve(look=looks.SAMPLES, x=t[::every], y=y[::every])


def _inside(one: MatchedTest, name: str) -> np.ndarray:
    """Return the samples of a channel, or "t", in the window of the test."""
    samples = one.record.t if name == "t" else one.record[name]
    return samples[(one.record.t >= one.window.start) & (one.record.t <= one.window.end)]


def _surfaces(one: MatchedTest) -> Panel:
    """Return surfaces as flown, and with what a controller added to the last simulation."""
    added = list(one.sides.values())[-1].flown.corrections
    parts: list[Part] = []
    for name, look in _SURFACES.items():
        if name not in one.record:
            continue
        values = np.degrees(_inside(one, name))
        parts.append(Curve(look=look, x=one.flight.t, y=values))
        if name in added:
            parts.append(Curve(look=_CORRECTED, x=one.flight.t, y=values + np.degrees(added[name])))
    return _panel(one, "surfaces, driven", "deg", parts)


_VERDICTS = {True: "pass", False: "FAIL", None: "not judged"}
_USED = {True: "yes", False: "no", None: "not known"}


def write_match(proof: ProofOfMatch, folder: str | Path) -> None:
    """Write `match.html` and `match_figures/*.svg` into `folder`, which is made."""
    rationales = [rationale_of(one, proof.tests, proof.lost, proof.findings) for one in proof.tests]
    explained = list(zip(proof.tests, rationales, strict=True))
    pictures = [*map(match_figure, proof.tests), *(related_figure(one) for one, why in explained if why)]
    figures = drawn_into(Path(folder) / "match_figures", filter(None, pictures))
    context = {
        "colour": GOOD if proof.passed else BAD,
        "justified": _justified([one for one in rationales if one], len(proof.lost)),
        "proof": proof,
        "summary": _summary(proof),
        "left_out": _left_out(proof),
        "tests": [_page(one, why, figures) for one, why in explained],
        "word": "Pass" if proof.passed else "Fail" if any(one.passed is False for one in proof.tests) else "Not proved",
        "sentence": proof.sentence,
        "next": list(_next(proof)),
    }
    (Path(folder) / "match.html").write_text(render("match.html", context), encoding="utf-8")


def _next(proof: ProofOfMatch) -> Iterator[NextStep]:
    """Yield what brings the proof further: the cause of what is out of tolerance, and flights as the standard asks."""
    if any(one.passed is False for one in proof.tests):
        command = "casid diagnose RECORD ... --aircraft FILE --out OUT"
        yield NextStep(text="Find what the model lacks where it is out of tolerance:", command=command)
    unmet = dict.fromkeys(f"{one.test.id} {one.test.title}" for one in proof.tests if one.unmet)
    if unmet:
        yield NextStep(text=f"Fly again as the standard asks; each sheet states what was not met: {', '.join(unmet)}.")


def _summary(proof: ProofOfMatch) -> ReportTable:
    rows = []
    for one in proof.tests:
        row = {
            "test": f"{one.test.id} {one.test.title}",
            "record": f"{one.record.name}, {one.window.start:.1f} to {one.window.end:.1f} s",
        }
        for label, side in one.sides.items():
            used = max((check.used for check in side.checks if math.isfinite(check.used)), default=math.nan)
            row |= {f"{label}: tolerance used": _used(used), label: _VERDICTS[side.passed]}
        rows.append(row | {"conditions": "not met" if one.unmet else "met", "record fitted": _USED[one.fitted]})
    failed = where(one.passed is False for one in proof.tests)
    return ReportTable.of(rows, "Tests, in the order of the standard.", marked=failed)


def _justified(found: Sequence[Rationale], lost: int) -> str:
    """State in one sentence how many tests out of tolerance are justified."""
    if not found:
        return ""
    accepted = sum(one.accepted for one in found)
    return (
        f"{accepted} of {len(found)} tests that are out of tolerance as given have a rationale with a repaired model "
        f"that is in tolerance. {lost or 'None'} of the tests in tolerance before is lost by it."
    )


def _conditions(one: MatchedTest) -> ReportTable:
    words = {True: "met", False: "NOT MET", None: "not known"}
    rows = [
        {"condition": each.name, "asked": each.asked, "found": each.found, "result": words[each.met]}
        for each in one.conditions
    ]
    return ReportTable.of(rows, "Conditions of the test", marked=where(each.met is False for each in one.conditions))


def related_figure(one: MatchedTest) -> Picture | None:
    """Draw up to four channels that the test does not compare and that the change brings nearest to flight."""
    names = _related(one)
    if not names:
        return None
    t = _inside(one, "t")
    panels = []
    for name in names:
        factor, unit = channel_scale(name)
        curves = [
            Curve(look=_LINES[label], x=t, y=factor * side.flown.channels[name]) for label, side in one.sides.items()
        ]
        panels.append(_panel(one, told(name), unit, [_dots(t, factor * _inside(one, name)), *curves]))
    return Picture(
        name=_file(one, "_related"),
        figure=Figure(rows=stacked(panels, 2), width=WIDE),
        title=f"{one.test.id}: related variables",
        caption="Related variables, which the test does not compare, in the same manoeuvre.",
        alt=f"Time histories of {', '.join(map(told, names))}: flight, as given and extended.",
    )


def _related(one: MatchedTest) -> list[str]:
    """Name the channels whose error the change reduces most."""
    given, extended = (side.flown.channels for side in (one.sides[GIVEN], one.sides[EXTENDED]))
    gains: dict[str, float] = {}
    for name in (n for n in extended if n in given and n in one.record and n not in one.test.channels):
        y = _inside(one, name)
        seen = np.isfinite(y)
        if seen.any() and np.ptp(y[seen]) > 0.0:
            before, after = (float(np.sqrt(np.mean((x[name] - y)[seen] ** 2))) for x in (given, extended))
            gains[name] = (before - after) / max(before, 1e-300)
    return sorted((name for name in gains if gains[name] > 0.0), key=lambda name: -gains[name])[:4]


def _left_out(proof: ProofOfMatch) -> ReportTable:
    rows = [{"test": f"{name} {proof.standard.tests[name].title}", "why": why} for name, why in proof.left_out.items()]
    return ReportTable.of(rows, "Tests of the table that were not compared.")


def _page(one: MatchedTest, why: Rationale | None, figures: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "one": one,
        "rationale": why,
        "figure": figures[_file(one)],
        "related": figures.get(_file(one, "_related")),
        "verdicts": {
            label: (_VERDICTS[side.passed].split()[0], one.outcome(label)) for label, side in one.sides.items()
        },
        "conditions": _conditions(one),
        "used": _USED[one.fitted],
        "histories": _compared(one, False),
        "quantities": _compared(one, True),
        "costs": _costs(one),
        "idle": [cost.part for cost in one.costs if not cost.lost],
        "added": {label: _added(side) for label, side in one.sides.items() if side.flown.corrections},
        "diverged": [f"{label}: {s.flown.diverged}" for label, s in one.sides.items() if s.flown.diverged],
    }


def _added(side: Side) -> str:
    """Return the largest corrections of a controller."""
    most = {name: math.degrees(float(np.abs(values).max())) for name, values in side.flown.corrections.items()}
    return ", ".join(f"{label_of(name)} up to {degrees:.2f} deg" for name, degrees in most.items())


def _compared(one: MatchedTest, of_quantities: bool) -> ReportTable:
    """Return a line for each time history, or each derived quantity, and side; what is common to the sides is in the
    first."""
    rows = []
    failed = []
    for number, row in enumerate(one.test.tolerances):
        if (row.quantity is not None) != of_quantities:
            continue
        limit = _limit_in_words(one, row)
        for place, (label, side) in enumerate(one.sides.items()):
            check = side.checks[number]
            deviation = _in_unit(check.deviation, row)
            if of_quantities:
                common = {"quantity": row.words, "tolerance": limit, "flight ± 1σ": _quantity(check.flight, row)}
                own = {"simulation": label, "value ± 1σ": _quantity(check.simulation, row), "deviation": deviation}
            else:
                at = f"{check.at_s:.2f}" if math.isfinite(check.at_s) else "–"
                out = f"{check.out_s:.2f} of {check.in_s + check.out_s:.2f}" if math.isfinite(check.out_s) else "–"
                common = {"compared": row.words, "tolerance": limit}
                own = {"simulation": label, "largest deviation": deviation, "at [s]": at, "time out [s]": out}
            first = common if place == 0 else dict.fromkeys(common, "")
            outcome = _VERDICTS[check.passed] + (f": {check.why}" if check.why else "")
            rows.append({**first, **own, "tolerance used": _used(check.used), "result": outcome})
            failed.append(check.passed is False)
    told = "Derived quantities, measured from both in the same way" if of_quantities else "Time histories"
    return ReportTable.of(rows, told, numeric=not of_quantities, marked=where(failed))


def _limit_in_words(one: MatchedTest, row: Tolerance) -> str:
    others = [r.words for r in one.test.tolerances if r.either and r.either == row.either and r != row]
    return f"{row}" + (f", or {' or '.join(others)}" if others else "")


def _in_unit(value: float, row: Tolerance) -> str:
    if not math.isfinite(value):
        return "–"
    return f"{digits(value / row.factor)} {row.unit}" if row.unit != "1" else digits(value)


def _quantity(value: Quantity | None, row: Tolerance) -> str:
    if value is None or not math.isfinite(value.value):
        return "–"
    return with_std(value.value / row.factor, value.std / row.factor, row.unit)


def _used(value: float) -> str:
    """Format in per cent, and more closely near the limit: at 100 % a row passes."""
    if not math.isfinite(value):
        return "–"
    return f"{100.0 * value:.2f}\u00a0%" if 0.99 < value < 1.01 else f"{100.0 * value:.0f}\u00a0%"


def _costs(one: MatchedTest) -> ReportTable:
    """Tabulate the part of each tolerance that is used with all parts, and without each that costs one."""
    names = [row.name for row in one.test.tolerances]
    words = {row.name: row.words for row in one.test.tolerances}
    costs = [cost for cost in one.costs if cost.lost]
    rows = []
    if costs:
        whole = {check.tolerance.name: check.used for check in one.sides[EXTENDED].checks}
        rows.append(("extended, whole", *(_used(whole[name]) for name in names), ""))
    for cost in costs:
        lost = ", ".join(words[name] for name in cost.lost)
        told = f"{lost} out of tolerance{'; the test fails' if cost.fails else ''}"
        rows.append((f"without {cost.part}", *(_used(cost.used[name]) for name in names), told))
    head = ("part taken out", *(words[name] for name in names), "costs")
    caption = "Which part costs which tolerance: tolerance used, parts of the extended aircraft taken out in turn"
    fails = where([False, *(cost.fails for cost in costs)])
    return ReportTable(head=head, rows=rows, marked=fails, caption=caption)
