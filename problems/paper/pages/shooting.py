"""Pictures and tables of the comparison of shooting methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from casid.report import looks
from casid.report.figure import Axis, Bar, Curve, Figure, Panel, Picture, stacked
from casid.report.looks import Look
from problems.paper.pages.page import Section, figure, paragraph, table, write_page

Results = Mapping[str, Mapping[str, Any]]  # "aircraft/method/kind ..." -> result
_KINDS = ("right optimum", "wrong, claimed converged", "wrong, said so")
_LOOKS = tuple(
    Look(name=name, colour=colour)
    for name, colour in zip(_KINDS, (looks.GREEN, looks.ORANGE, looks.FAINT), strict=True)
)


def outcome(result: Mapping[str, Any]) -> int:
    """0 right optimum, 1 wrong although the solver claims success, 2 wrong and said so."""
    return 0 if result["right"] else 1 if result["claimed"] else 2


def _of(results: Results, aircraft: str, method: str, kind: str) -> list[Mapping[str, Any]]:
    return [result for key, result in results.items() if key.startswith(f"{aircraft}/{method}/{kind}")]


def summary(results: Results, aircraft: str, methods: Sequence[str]) -> list[list[Any]]:
    """Rows method, right, wrong claimed, starts (random ones), then iterations, seconds, cost, error from the paper's
    start; median iterations and seconds of the random starts that ended right."""
    rows = []
    for method in methods:
        random, paper = _of(results, aircraft, method, "random"), _of(results, aircraft, method, "paper")
        kinds = [outcome(result) for result in random]
        good = [result for result in random if result["right"]]
        middle = [float(np.median([r[name] for r in good])) if good else None for name in ("iterations", "seconds")]
        first = paper[0]
        rows.append(
            [
                method,
                kinds.count(0),
                kinds.count(1),
                len(random),
                "yes" if first["right"] else "no",
                first["iterations"],
                first["seconds"],
                first["cost"],
                first["error"],
                *middle,
            ]
        )
    return rows


HEAD = (
    "method",
    "right of random starts",
    "wrong but claimed",
    "starts",
    "right from 0.7 x true",
    "iterations",
    "seconds",
    "cost",
    "largest error",
    "median iterations",
    "median seconds",
)


def success_picture(results: Results, aircraft: Sequence[str], methods: Sequence[str]) -> Picture:
    """Share of the random starts by what became of them, for every method."""
    panels = []
    for name in aircraft:
        bars = []
        left = np.zeros(len(methods))
        for kind, look in enumerate(_LOOKS):
            groups = [[outcome(r) for r in _of(results, name, m, "random")] for m in methods]
            share = np.array([100.0 * group.count(kind) / max(len(group), 1) for group in groups])
            bars += [
                Bar(look=look, at=at, low=float(left[at]), high=float(left[at] + share[at]))
                for at in range(len(methods))
            ]
            left += share
        x = Axis(label="random starts [%]", low=0.0, high=100.0)
        y = Axis(names=tuple(methods))
        panels.append(Panel(parts=tuple(bars), x=x, y=y, title=name, height=0.3 * len(methods) + 0.2))
    return Picture(
        name="success",
        figure=Figure(rows=stacked(panels, len(panels))),
        title="Who finds the right optimum from far away",
        caption="Starts: every derivative U(0, 2) times its true value, a fifth of the signs flipped.",
        alt="Bars: share of random starts that end in the right optimum, by method.",
    )


def basin_picture(results: Results, aircraft: Sequence[str], methods: Sequence[str], names: Sequence[str]) -> Picture:
    """Where a start may lie in the plane of two derivatives: one square per start, coloured by what became of it."""
    panels = []
    truth = Curve(look=Look(colour=looks.INK, dash="", marker="P", size=7.0), x=np.ones(1), y=np.ones(1))
    for name in aircraft:
        for method in methods:
            kinds: dict[int, list[tuple[float, float]]] = {}
            for key, result in results.items():
                if key.startswith(f"{name}/{method}/basin"):
                    x, y = (float(part) for part in key.split()[-2:])
                    kinds.setdefault(outcome(result), []).append((x, y))
            squares = [
                Curve(look=replace(_LOOKS[kind], dash="", marker="s", size=9.0), x=places[:, 0], y=places[:, 1])
                for kind, places in ((kind, np.array(starts)) for kind, starts in kinds.items())
            ]
            x, y = (Axis(label=f"{one} / true") for one in names)
            panels.append(Panel(parts=(*squares, truth), x=x, y=y, title=f"{name}, {method}", height=1.9))
    return Picture(
        name="basin",
        figure=Figure(rows=stacked(panels, len(methods)), linked=False),
        title="The basin of attraction, cut along two derivatives",
        caption="Each square is a start; the other derivatives start at 0.7 times their true values. The cross is the "
        "truth. Upper row: the stable aircraft; lower row: the destabilised one.",
        alt="Grids of starts coloured by whether the right optimum is found, for three methods.",
    )


def write_shooting_page(
    path: str | Path,
    results: Results,
    aircraft: Sequence[str],
    methods: Sequence[str],
    basin: tuple[Sequence[str], Sequence[str]],
    right: float,
    made_with: Mapping[str, Any],
) -> None:
    """Write the page of the comparison; `basin`: methods of the basin picture, and its two derivatives."""
    pictures = [success_picture(results, aircraft, methods)]
    shown = [m for m in basin[0] if any(f"/{m}/basin" in key for key in results)]
    if shown:
        pictures.append(basin_picture(results, aircraft, shown, basin[1]))
    sections = [Section(title="Pictures", parts=[figure(picture) for picture in pictures])]
    for name in aircraft:
        parts = [table(HEAD, summary(results, name, methods), f"{name} aircraft")]
        sections.append(Section(title=f"Table, {name}", parts=parts))
    lead = [
        "One noisy record of 20 s, open loop on measured surfaces, output error with the true noise as weights.",
        f"Right means: all 16 parameters within {right:g} standard deviations of the optimum that is found from the "
        "truth; the solver's own word is counted apart. All hard methods have one optimum. Soft defects take the noise "
        "of the surfaces as process noise, which it is here; each interval has its own optimum, because a defect is "
        "weighed at the nodes only. Single shooting is multiple shooting with the interval 'all'.",
        "The largest error is that of the derivative with the largest relative error against the truth.",
    ]
    sections.append(
        Section(
            title="How to read seconds",
            parts=[
                paragraph("Wall time of one estimation on a machine that may be busy; first runs include compiling.")
            ],
        )
    )
    write_page(path, "Single shooting, multiple shooting, collocation", lead, sections, made_with)
