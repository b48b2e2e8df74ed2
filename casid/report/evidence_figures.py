"""Figures of the evidence for and against causes: rankings, ambiguity, residual energy by frequency."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.colors import LogNorm
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from casid.diagnosis.document import Document, Tried
from casid.report.style import (
    BASELINE,
    EXPLAINED,
    EXTENDED,
    FAINT,
    MEASURED,
    NOISE,
    Picture,
    blank,
    legend,
    powers_of_ten,
)
from casid.report.words import EVIDENCE, label, place, pretty, quantity

_MOST_INSTRUMENTS = 16
_MOST_PLACES = 10
_FACES: Mapping[str, dict[str, Any]] = MappingProxyType(
    {
        "named": {"facecolor": EXTENDED, "edgecolor": EXTENDED},
        "fitted, explains less": {"facecolor": FAINT, "edgecolor": FAINT},
        "too small to matter, or implausible": {"facecolor": NOISE, "edgecolor": MEASURED, "hatch": "..."},
        "refuted by kinematics": {"facecolor": "white", "edgecolor": MEASURED, "hatch": "////"},
    }
)


def ladder(document: Document) -> Picture | None:
    """Evidence for every cause that was fitted, round by round, and of the named ones on held-out records."""
    rows = document.tried
    if not rows:
        return None
    several = len({one.round for one in rows}) > 1
    figure = blank(0.34 * len(rows) + 1.7)
    ax = figure.subplots()
    held_out = []
    faces = []
    for y, trial in enumerate(rows):
        faces.append(_face(trial))
        ax.barh(y, max(trial.statistic, 1.0), 0.7, **faces[-1])
        held = _held_out(document, trial) if trial.named else None
        if held is not None and held > 0:
            held_out.append(held)
            ax.plot(held, y, "D", color=BASELINE, mec="white", ms=8, zorder=3)
    asked = document.criteria.naming
    ax.axvline(asked.gain, color=MEASURED, ls=":", lw=1.2)
    ax.set_xscale("log")
    powers_of_ten(ax.xaxis)
    ax.set_xlim(1.0, 3.0 * max(100.0, *(one.statistic for one in rows), *held_out))
    ax.set_yticks(range(len(rows)), [label(_row_name(one, several)) for one in rows])
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("likelihood-ratio statistic (log scale)")
    handles: list[Artist] = [Patch(**face) for face in _FACES.values() if face in faces]
    words = [word for word, face in _FACES.items() if face in faces]
    if held_out:
        handles.append(Line2D([], [], ls="", marker="D", color=BASELINE))
        words.append("the same on held-out records")
    handles.append(Line2D([], [], color=MEASURED, ls=":"))
    figure.legend(handles, [*words, "least statistic for a name"], loc="outside upper center", ncols=2)
    best = rows[0]
    name = pretty(rows[0].title)
    return Picture(
        name="ladder",
        figure=figure,
        title="Which cause: the likelihood-ratio statistic of each one when it is fitted",
        caption=(
            f"Each bar is a full fit of the extended model. {EVIDENCE} To be named a cause needs {asked.gain:.0f} more "
            f"than its free numbers bring by chance, a fault of an instrument {asked.gain_of_an_instrument:.0f}. What "
            "small further terms could explain as well does not count. "
            + ("Round 2 starts from the model with the first cause, and so on." if several else "")
        ),
        alt=f"Bar chart of {len(rows)} fitted causes by likelihood-ratio statistic; the first is {name} with "
        f"{best.statistic:.0f}.",
    )


def _face(trial: Tried) -> dict[str, Any]:
    if trial.refuted:
        return _FACES["refuted by kinematics"]
    if not trial.meaningful:
        return _FACES["too small to matter, or implausible"]
    return _FACES["named" if trial.named else "fitted, explains less"]


def _row_name(one: Tried, several: bool) -> str:
    return f"{f'{one.round}. ' if several else ''}{pretty(one.title)} ({quantity(one.value, one.unit)})"


def _held_out(document: Document, trial: Tried) -> float | None:
    """2 Δ ln L on the held-out records of the cause that this trial became."""
    cause = next((c for c in (*document.causes, *document.minor) if c.key == trial.key), None)
    if cause is None or cause.held_out_gain is None:
        return None
    return 2.0 * cause.held_out_gain * document.held_out_extended.samples


def missing(document: Document) -> Picture:
    """Likelihood-ratio statistics of latent inputs at the ports where they are largest, before naming and after."""
    before = document.missing_before
    after = document.missing_after
    unexplained = [one.station for one in document.unexplained if one.fitted][:1]
    chosen = {*sorted(before, key=lambda s: -max(before[s], after.get(s, 0.0)))[:_MOST_PLACES], *unexplained}
    order = sorted(chosen, key=lambda s: -before[s])
    figure = blank(0.36 * len(order) + 1.4)
    ax = figure.subplots()
    extended = bool(document.causes)
    y = np.arange(len(order))
    height = 0.38 if extended else 0.7
    ax.barh(
        y - (height / 2 if extended else 0),
        [max(before[s], 1.0) for s in order],
        height,
        color=BASELINE,
        label="re-estimated model, without causes",
    )
    if extended:
        ax.barh(y + height / 2, [max(after[s], 1.0) for s in order], height, color=EXTENDED, label="extended model")
    for station in unexplained:
        at = (max(before[station], after[station]), order.index(station))
        ax.annotate("unexplained here", at, xytext=(5, 0), textcoords="offset points", va="center", weight="bold")
    ax.set_xscale("log")
    powers_of_ten(ax.xaxis)
    ax.set_xlim(1.0, 10.0 * max(100.0, *before.values(), *after.values()))
    ax.set_yticks(y, [place(s) for s in order])
    ax.set_ylim(len(order) - 0.4, -0.6)
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("statistic of a latent input there (log scale)")
    legend(figure, [ax], 2)
    return Picture(
        name="missing",
        figure=figure,
        title="Where something is missing",
        caption=(
            "A latent input, an unknown function of time, is added at one port of the signal path at a time. A large "
            "statistic means that something enters there; neighbouring ports share that of one cause. The rest "
            "counts as unexplained only if it is large and the model discrepancy cannot explain it either."
        ),
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
    figure = blank(0.29 * len(order) + 1.2)
    ax = figure.subplots()
    over = [best[k][0] > limit for k in order]
    ax.barh(
        range(len(order)),
        [best[k][0] for k in order],
        0.7,
        color=[BASELINE if o else EXPLAINED for o in over],
        hatch=["//" if o else "" for o in over],
        edgecolor="white",
        linewidth=0,
    )
    for y, key in enumerate(order):
        if over[y]:
            ax.annotate(
                best[key][1], (best[key][0], y), xytext=(5, 0), textcoords="offset points", va="center", fontsize=9
            )
    ax.axvline(limit, color=MEASURED, ls=":", lw=1.2)
    ax.set_xlim(0.0, max(1.6 * best[order[0]][0], 1.3 * limit))
    ax.set_yticks(range(len(order)), order)
    ax.set_ylim(len(order) - 0.4, -0.6)
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("|z| of its strongest fault (dotted: limit)")
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
        figure=figure,
        title=f"Kinematic check: {cleared}",
        caption=(
            "Rates, accelerations, attitude and air data must agree with each other whatever the aerodynamics are. "
            f"What fails here (hatched) is an instrument or moving air, and nothing else.{drawn}{note}"
        ),
        alt=f"Bar chart of |z| per instrument; {cleared}; the largest is {order[0]} with {best[order[0]][0]:.0f}.",
    )


_MOST = 1e4
_BAR = 0.04  # height of the scale of colours over that of the panels


def heatmap(document: Document) -> Picture | None:
    """Channel by frequency, before and after."""
    edges = document.as_given.bands
    outputs = document.as_given.outputs
    views = [("file as given", document.as_given), (document.best, document.extended)]
    figure = blank(0.27 * len(outputs) + 1.8)
    grid = figure.add_gridspec(2, len(views), height_ratios=(1.0, _BAR))
    axes = [figure.add_subplot(grid[0, k]) for k in range(len(views))]
    image = None
    energies = []
    for ax, (title, view) in zip(axes, views, strict=True):
        energies.append(view.energy)
        image = ax.imshow(np.clip(view.energy, 1.0, _MOST), aspect="auto", cmap="YlOrBr", norm=LogNorm(1.0, _MOST))
        ax.set_title(title)
        ax.set_yticks(range(len(outputs)), outputs if ax is axes[0] else [""] * len(outputs))
        ax.set_xticks(np.arange(len(edges)) - 0.5, [f"{e:g}" for e in edges], rotation=0, fontsize=8.5)
        ax.set_xlabel("frequency [Hz]")
        ax.grid(visible=False)
    if image is None or not np.isfinite(energies[0]).any():
        return None  # no record is long or fast enough for a band
    bar = figure.colorbar(image, cax=figure.add_subplot(grid[1, :]), orientation="horizontal", extend="both")
    powers_of_ten(bar.ax.xaxis)
    bar.set_label("energy of the residual / energy of the noise")
    i, b = np.unravel_index(np.nanargmax(energies[0]), energies[0].shape)
    worst = f"{outputs[i]} at {edges[b]:g} to {edges[b + 1]:g} Hz"
    return Picture(
        name="heatmap",
        figure=figure,
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
    figure = blank(0.42 * len(names) + 1.7)
    ax = figure.subplots()
    ax.imshow(cosine, vmin=0.0, vmax=1.0, cmap="Blues", aspect="auto")
    for i, row in enumerate(cosine):
        for j, value in enumerate(row):
            colour = "white" if value > 0.6 else "black"
            ax.text(j, i, f"{value:.2f}", ha="center", va="center", color=colour, fontsize=8)
    ax.set_yticks(range(len(names)), [label(f"{n}  ({chr(65 + i)})") for i, n in enumerate(names)])
    ax.set_xticks(range(len(names)), [chr(65 + i) for i in range(len(names))])
    ax.grid(visible=False)
    off = cosine - np.eye(len(names))
    i, j = np.unravel_index(np.argmax(off), off.shape)
    return Picture(
        name="ambiguity",
        figure=figure,
        title="How alike the causes look in these records",
        caption=(
            "|cos| of the angle between two fingerprints once the fitted derivatives have explained what they can: 1, "
            "the two cannot be told apart; 0, they have nothing in common."
        ),
        alt=f"Matrix of |cos| between {len(names)} causes; most alike are {names[i]} and {names[j]}, {off[i, j]:.2f}.",
    )
