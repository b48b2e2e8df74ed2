"""Natural modes and handling qualities: their figures and their page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from casid.acceptance.handbook import Handbook, Number, labelled
from casid.acceptance.theil import Theil
from casid.report import looks
from casid.report.figure import WIDE, Axis, Band, Curve, Figure, Note, Panel, Part, Picture, Rule
from casid.report.result_page import Answer, write_result
from casid.report.sections import ReportTable
from casid.report.svg import shown
from casid.report.words import channel_axis, channel_scale, digits, pretty, quantity, with_std

_FAST = ("short period", "dutch roll", "roll")
_SLOW = ("phugoid", "spiral")
_CURVES = ("delta_e", "alpha", "thrust")


def plot(handbook: Handbook) -> Any:
    """Return eigenvalues and trim curves of an aircraft for a notebook."""
    found = {handbook.aircraft: handbook}
    rows = (*eigenvalues(found).figure.rows, *trim_curves(found).figure.rows)
    return shown(Figure(rows=rows, width=WIDE, linked=False))


def eigenvalues(found: Mapping[str, Handbook]) -> Picture:
    """Return the modes in the complex plane, fast and slow ones apart."""
    others = {name for one in found.values() for name in one.modes} - {*_FAST, *_SLOW}
    slow_others = {n for one in found.values() for n in others & one.modes.keys() if abs(one.modes[n].eigenvalue) < 0.3}
    groups = {"fast modes": {*_FAST, *(others - slow_others)}, "slow modes": {*_SLOW, *slow_others}}
    row = tuple(_modes(found, title, names) for title, names in groups.items())
    return Picture(
        name="eigenvalues",
        figure=Figure(rows=(row,), width=WIDE, linked=False),
        title="Modes of motion",
        caption="Eigenvalues of the linearised aircraft, of each pair the upper one, with 2-sigma intervals. "
        "Left of the dotted line a motion decays.",
        alt=f"Eigenvalues of the modes of {', '.join(found)} in the complex plane.",
    )


def trim_curves(found: Mapping[str, Handbook]) -> Picture:
    """Return elevator, angle of attack and thrust of level flight over airspeed."""
    row = tuple(_trim(found, name) for name in _CURVES)
    return Picture(
        name="trim_curves",
        figure=Figure(rows=(row,), width=WIDE),
        title="Trim of level flight",
        caption="What level flight takes at every airspeed, with 2-sigma bands; dotted: the flight point of the modes.",
        alt=f"Elevator, angle of attack and thrust over airspeed for {', '.join(found)}.",
    )


def _looks(found: Mapping[str, Handbook]) -> dict[str, looks.Look]:
    """Return the look of each aircraft, the first as given; a legend only where there are several."""
    own = looks.of_models(found, next(iter(found), None))
    return own if len(own) > 1 else {label: look.called("") for label, look in own.items()}


def _modes(found: Mapping[str, Handbook], title: str, names: set[str]) -> Panel:
    parts: list[Part] = [Rule(look=looks.LIMIT, at=0.0)]
    places = []
    for k, (label, look) in enumerate(_looks(found).items()):
        dots = replace(look, dash="", marker="os^Dv"[k % 5], size=5.5)
        for name, mode in found[label].modes.items():
            if name not in names:
                continue
            at = mode.eigenvalue
            std, std_of_im = (np.array([2.0 * s if np.isfinite(s) else 0.0]) for s in mode.eigenvalue_std)
            x, y = np.array([at.real]), np.array([at.imag])
            parts.append(Curve(look=dots, x=x, y=y, std_x=std, std=std_of_im if at.imag > 0.0 else None))
            places.append(at)
            if k == 0:
                right = at.real > 0.5 * min((one.real for one in places), default=0.0)
                align, off = ("right", -6.0) if right else ("left", 6.0)
                parts.append(Note(text=name, x=at.real, y=at.imag, align=align, offset=(off, 9.0)))
    high = max((one.imag for one in places), default=1.0) or 1.0
    return Panel(
        parts=tuple(parts),
        x=Axis(label="decay σ [1/s]", step=0.1 if "roll" in names else None),
        y=Axis(label="ω [rad/s]", low=-0.12 * high),
        title=title,
        height=2.7,
    )


def _trim(found: Mapping[str, Handbook], name: str) -> Panel:
    factor = channel_scale(name)[0]
    parts: list[Part] = []
    for label, look in _looks(found).items():
        curves = found[label].trim_curves
        value = factor * curves.values[name]
        spread = 2.0 * factor * np.nan_to_num(curves.std[name])
        faint = replace(look.called(""), alpha=0.18)
        parts.append(Band(look=faint, x=curves.V, low=value - spread, high=value + spread))
        parts.append(Curve(look=look, x=curves.V, y=value))
        parts.append(Rule(look=replace(look.called(""), width=0.9, dash=":"), at=found[label].flight["V"]))
    return Panel(parts=tuple(parts), x=Axis(label="V [m/s]"), y=Axis(label=channel_axis(name)), height=2.1)


TheilTable = Mapping[str, Mapping[str, Mapping[str, Theil]]]  # record -> label -> channel -> Theil


def write_modes(found: Mapping[str, Handbook], theil: TheilTable, folder: str | Path) -> None:
    """Write `modes.html` and `modes_figures/*.svg` into `folder`, which is made."""
    first = next(iter(found.values()))
    point = f"V = {digits(first.flight['V'])} m/s, density {digits(first.flight['rho'])} kg/m³"
    told = [f"{label}: {_stability(one)}" for label, one in found.items()]
    answer = Answer(
        badge="",
        sentence=told[0],
        points=(*told[1:], f"Steady straight flight at {point}, stick fixed, constant thrust."),
    )
    parts = [
        [pretty(one) for one in _notes(found)],
        _numbers(found),
        eigenvalues(found),
        trim_curves(found),
        *(_theil(record, table) for record, table in theil.items()),
    ]
    title = f"Handbook numbers: {first.aircraft}"
    write_result(folder, "modes", title, answer, parts, "modes_figures")


def _stability(found: Handbook) -> str:
    """State which modes grow, and how fast, and the static margin."""
    grows = {name: mode.numbers for name, mode in found.modes.items() if mode.eigenvalue.real > 0.0}
    told = [f"the {n} grows and doubles in {_cell(numbers.get('time_to_double'))}" for n, numbers in grows.items()]
    modes = f"{' and '.join(told)}; every other mode decays" if told else "every mode decays"
    margin = found.numbers.get("static_margin")
    return modes + (f". Static margin {_cell(margin)}." if margin else ".")


def _notes(found: Mapping[str, Handbook]) -> list[str]:
    return list(dict.fromkeys(f"{label}: {note}" for label, one in found.items() for note in one.notes))


def text(found: Mapping[str, Handbook], theil: TheilTable) -> str:
    """The numbers of all aircraft as text, one line each, and Theil's coefficients."""
    tables = (_theil(record, table) for record, table in theil.items())
    told = [f"\n{one.caption}\n{one.text()}" for one in tables]
    return "\n".join([_numbers(found).text(), *(f"! {note}" for note in _notes(found)), *told])


def _shares(one: Theil) -> str:
    return " / ".join(f"{100.0 * share:.0f}" for share in (one.bias, one.variance, one.covariance)) + " %"


def _numbers(found: Mapping[str, Handbook]) -> ReportTable:
    labels = dict.fromkeys(label for one in found.values() for label, _ in labelled(one))
    by_aircraft = [dict(labelled(one)) for one in found.values()]
    return ReportTable(
        head=("number", *found),
        rows=[(label, *(_cell(numbers.get(label)) for numbers in by_aircraft)) for label in labels],
        caption="± is one standard deviation, from what is known of the parameters; none where nothing is known. "
        "Margins are parts of the length of pitching moments.",
        numeric=True,
    )


def _cell(one: Number | None) -> str:
    if one is None:
        return "–"
    turning = one.unit == "rad/s"  # a circular frequency, which nobody reads in degrees
    unit = "" if turning else one.unit
    told = (
        with_std(one.value, one.std, unit) if np.isfinite(one.std) and one.std > 0.0 else quantity(one.value, unit, 4)
    )
    return f"{told.strip()} rad/s" if turning else told


def _theil(record: str, by_label: Mapping[str, Mapping[str, Theil]]) -> ReportTable:
    channels = dict.fromkeys(name for table in by_label.values() for name in table)
    rows = []
    for name in channels:
        row = [name]
        for table in by_label.values():
            one = table.get(name)
            row += [f"{one.coefficient:.3f}", _shares(one)] if one else ["–", "–"]
        rows.append(tuple(row))
    head = [cell for label in by_label for cell in (f"{label}: U", f"{label}: bias / variance / covariance")]
    return ReportTable(
        head=("channel", *head),
        rows=rows,
        caption=f"{record}, flown open loop: Theil's inequality coefficient U and the parts of its squared error.",
        numeric=True,
    )
