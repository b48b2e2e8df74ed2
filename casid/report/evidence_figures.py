"""Figures of the evidence for and against causes: rankings, ambiguity, residual energy by frequency."""

from __future__ import annotations

import math

import numpy as np

from casid.diagnosis.document import Document, Tried
from casid.report import looks
from casid.report.figure import Axis, Bar, Cells, Curve, Figure, Note, Panel, Picture, Rule, Scale, in_rows, stacked
from casid.report.words import EVIDENCE, place, pretty, quantity

_MOST_INSTRUMENTS = 16
_MOST_PLACES = 10
_NAMED = looks.Look(name="named", colour=looks.BLUE)
_LESS = looks.Look(name="fitted, explains less", colour=looks.FAINT)
_SMALL = looks.Look(name="too small to matter, or implausible", colour=looks.GREY, edge=looks.INK, hatch="...")
_REFUTED = looks.Look(name="refuted by kinematics", colour="#FFFFFF", edge=looks.INK, hatch="////")
_HELD_OUT = looks.Look(name="the same on held-out records", colour=looks.ORANGE, dash="", marker="D", size=7.0)
_CLEARED = looks.Look(name="cleared", colour=looks.GREEN)
_FAILS = looks.Look(name="fails", colour=looks.ORANGE, edge="#FFFFFF", hatch="//")


def ladder(document: Document) -> Picture | None:
    """Evidence for every cause that was fitted, round by round, and of the named ones on held-out records."""
    rows = document.tried
    if not rows:
        return None
    several = len({one.round for one in rows}) > 1
    asked = document.criteria.significance.search
    bars = [Bar(look=_look(one), at=y, low=1.0, high=max(one.statistic, 1.0)) for y, one in enumerate(rows)]
    held_out = {y: gain for y, one in enumerate(rows) if one.named and (gain := _held_out(document, one)) > 0.0}
    dots = Curve(look=_HELD_OUT, x=np.array([*held_out.values()]), y=np.array([*held_out], dtype=float))
    least = Rule(look=looks.LIMIT.called("least statistic for a name"), at=asked)
    most = 3.0 * max(100.0, *(one.statistic for one in rows), *held_out.values())
    parts = (*bars, *([dots] if held_out else []), least)
    x = Axis(label="likelihood-ratio statistic (log scale)", log=True, low=1.0, high=most)
    names = [
        f"{f'{one.round}. ' if several else ''}{pretty(one.title)} ({quantity(one.value, one.unit)})" for one in rows
    ]
    return Picture(
        name="ladder",
        figure=in_rows(parts, x, names, 0.34),
        title="Which cause: the likelihood-ratio statistic of each one when it is fitted",
        caption=(
            f"Each bar is a full fit of the extended model. {EVIDENCE} To be named a cause needs {asked:.0f} more than "
            "its free numbers bring by chance. What small further terms could explain as well does not count. "
            + ("Round 2 starts from the model with the first cause, and so on." if several else "")
        ),
        alt=f"Bar chart of {len(rows)} fitted causes by likelihood-ratio statistic; the first is "
        f"{pretty(rows[0].title)} with {rows[0].statistic:.0f}.",
    )


def _look(trial: Tried) -> looks.Look:
    if trial.refuted:
        return _REFUTED
    if not trial.meaningful:
        return _SMALL
    return _NAMED if trial.named else _LESS


def _held_out(document: Document, trial: Tried) -> float:
    """2 Δ ln L on the held-out records of the cause that this trial became; 0 where it was not judged there."""
    cause = next((one for one in (*document.causes, *document.minor) if one.key == trial.key), None)
    gain = cause.held_out_gain if cause else None
    return 2.0 * (gain or 0.0) * document.held_out_extended.samples


def missing(document: Document) -> Picture:
    """Likelihood-ratio statistics of latent inputs at the ports where they are largest, before naming and after."""
    before = document.missing_before
    after = document.missing_after
    unexplained = [one.station for one in document.unexplained if one.fitted][:1]
    chosen = {*sorted(before, key=lambda s: -max(before[s], after.get(s, 0.0)))[:_MOST_PLACES], *unexplained}
    order = sorted(chosen, key=lambda s: -before[s])
    extended = bool(document.causes)
    sides = {looks.GIVEN.called("re-estimated model, without causes"): before}
    if extended:
        sides[looks.EXTENDED.called("extended model")] = after
    height = 0.76 / len(sides)
    parts: list[Bar | Note] = [
        Bar(look=look, at=y + (k - 0.5 * (len(sides) - 1)) * height, low=1.0, high=max(values[s], 1.0), height=height)
        for k, (look, values) in enumerate(sides.items())
        for y, s in enumerate(order)
    ]
    for station in unexplained:
        end = max(before[station], after[station], 1.0)
        parts.append(Note(text="unexplained here", x=end, y=order.index(station), offset=(5.0, 0.0), bold=True))
    most = 10.0 * max(100.0, *before.values(), *after.values())
    x = Axis(label="statistic of a latent input there (log scale)", log=True, low=1.0, high=most)
    return Picture(
        name="missing",
        figure=in_rows(parts, x, [place(s) for s in order], 0.36),
        title="Where something is missing",
        caption="A latent input, an unknown function of time, is added at one port of the signal path at a time. A "
        "large statistic means that something enters there; neighbouring ports share that of one cause. The rest "
        "counts as unexplained only if it is large and the model discrepancy cannot explain it either.",
        alt=f"Bar chart of the likelihood-ratio statistic of an unknown input per place; largest before naming: "
        f"{place(order[0])}, {before[order[0]]:.0f}" + (f"; it has {after[order[0]]:.0f} after." if extended else "."),
    )


def kinematic(document: Document) -> Picture | None:
    """|z| of the strongest fault of every instrument, forces left free; None where kinematics cannot be checked."""
    best: dict[str, tuple[float, str]] = {}
    for one in document.suspects:
        key, of_an_instrument, _ = pretty(one.title).partition(":")
        fault = one.kind.replace("sensor_", "").replace("_", " ") if of_an_instrument else ""
        z = math.sqrt(max(one.statistic, 0.0))
        if z > best.get(key, (-1.0, ""))[0]:
            best[key] = (z, f"{fault} {quantity(one.value, one.unit)}".strip())
    if not best:
        return None
    limit = math.sqrt(document.criteria.significance.search)
    everyone = sorted(best, key=lambda k: -best[k][0])
    order = everyone[:_MOST_INSTRUMENTS]
    over = [best[k][0] > limit for k in order]
    parts: list[Bar | Note | Rule] = [Rule(look=looks.LIMIT.called("limit"), at=limit)]
    for y, key in enumerate(order):
        z, fault = best[key]
        parts.append(Bar(look=_FAILS if over[y] else _CLEARED, at=y, low=0.0, high=z))
        if over[y]:
            parts.append(Note(text=fault, x=z, y=y, offset=(5.0, 0.0)))
    x = Axis(label="|z| of its strongest fault", low=0.0, high=max(1.6 * best[order[0]][0], 1.3 * limit))
    cleared = f"{sum(best[k][0] <= limit for k in everyone)} of {len(everyone)} instruments and winds are cleared"
    drawn = f" The {len(order)} with the largest |z| are drawn." if len(order) < len(everyone) else ""
    note = (
        " They were scored in air as turbulent as the verdict says."
        if document.turbulent
        else " One fault shows in its neighbours as well; the strongest is the likeliest."
        if any(over)
        else ""
    )
    return Picture(
        name="kinematic",
        figure=in_rows(parts, x, order, 0.29),
        title=f"Kinematic check: {cleared}",
        caption="Rates, accelerations, attitude and air data must agree with each other whatever the aerodynamics are. "
        f"What fails here (hatched) is an instrument or moving air, and nothing else.{drawn}{note}",
        alt=f"Bar chart of |z| per instrument; {cleared}; the largest is {order[0]} with {best[order[0]][0]:.0f}.",
    )


_MOST = 1e4


def heatmap(document: Document) -> Picture | None:
    """Return channel by frequency, before and after."""
    edges = document.as_given.bands
    outputs = document.as_given.outputs
    views = {"file as given": document.as_given, document.best: document.extended}
    energies = [view.energy for view in views.values()]
    if not np.isfinite(energies[0]).any():
        return None  # no record is long or fast enough for a band
    scale = Scale(low=1.0, high=_MOST, colours="YlOrBr", log=True, label="energy of the residual / energy of the noise")
    panels = [
        Panel(
            parts=(Cells(values=view.energy, scale=scale),),
            x=Axis(label="frequency [Hz]", names=tuple(f"{e:g}" for e in edges), edges=True),
            y=Axis(names=tuple(outputs)),
            title=title,
            height=0.27 * len(outputs),
        )
        for title, view in views.items()
    ]
    i, b = np.unravel_index(np.nanargmax(energies[0]), energies[0].shape)
    worst = f"{outputs[i]} at {edges[b]:g} to {edges[b + 1]:g} Hz"
    return Picture(
        name="heatmap",
        figure=Figure(rows=stacked(panels, 2)),
        title="Which channels, which frequencies",
        caption="Palest: nothing but noise. Darkest: ten thousand times the energy of the noise. Fitted records.",
        alt=f"Heatmap of residual over noise energy, channel by frequency. Largest before: {worst}, "
        f"{energies[0][i, b]:.0f} times the noise; after: {energies[1][i, b]:.0f} times.",
    )


def ambiguity(document: Document) -> Picture | None:
    """|cos| between the fingerprints of the causes fitted in the first round; None for fewer than two."""
    titles, cosine = document.alike
    if len(titles) < 2:
        return None
    names = [pretty(one) for one in titles]
    letters = tuple(chr(65 + i) for i in range(len(names)))
    panel = Panel(
        parts=(
            Cells(
                values=cosine,
                scale=Scale(low=0.0, high=1.0, colours="Blues"),
                texts={place: f"{value:.2f}" for place, value in np.ndenumerate(cosine)},
            ),
        ),
        x=Axis(names=letters),
        y=Axis(names=tuple(f"{n}  ({letter})" for n, letter in zip(names, letters, strict=True))),
        height=0.42 * len(names),
    )
    off = cosine - np.eye(len(names))
    i, j = np.unravel_index(np.argmax(off), off.shape)
    return Picture(
        name="ambiguity",
        figure=Figure(rows=((panel,),)),
        title="How alike the causes look in these records",
        caption="|cos| of the angle between two fingerprints once the fitted derivatives have explained what they "
        "can: 1, the two cannot be told apart; 0, they have nothing in common.",
        alt=f"Matrix of |cos| between {len(names)} causes; most alike are {names[i]} and {names[j]}, {off[i, j]:.2f}.",
    )
