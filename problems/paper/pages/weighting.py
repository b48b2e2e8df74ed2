"""Pictures and tables of the weighting of the combined estimator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from casid.report import looks
from casid.report.figure import Axis, Curve, Figure, Note, Panel, Part, Picture, Rule
from problems.paper.pages.page import table

_ENDS = {"0": "output", "1": "equation"}
Results = Mapping[str, Mapping[str, Any]]


def means(results: Results, prefix: str) -> dict[str, float]:
    """Statistic -> mean over the runs below a key that have not departed; empty when there is none."""
    runs = [r["statistics"] for key, r in results.items() if key.startswith(prefix) and not r["departed"]]
    return {name: float(np.mean([run[name] for run in runs])) for name in runs[0]} if runs else {}


def index(values: Mapping[str, float], names: Sequence[str]) -> float:
    """Geometric mean of some statistics: one number for a domain, whatever the sizes of its members."""
    return float(np.exp(np.mean(np.log([max(values[name], 1e-300) for name in names])))) if values else float("nan")


def curve_rows(
    results: Results, cases: Sequence[str], weights: Sequence[float], domains: Mapping[str, Sequence[str]]
) -> list[list[Any]]:
    """Rows case, weight, then the index of every domain relative to its value at 50/50."""
    rows = []
    for case in cases:
        middle = means(results, f"curve/{case}/0.5/")
        for weight in weights:
            own = means(results, f"curve/{case}/{weight:g}/")
            if own and middle:
                rows.append([case, f"{weight:g}", *(index(own, n) / index(middle, n) for n in domains.values())])
    return rows


def curve_table(rows: Sequence[Sequence[Any]], domains: Mapping[str, Sequence[str]]) -> str:
    return table(["case", "equation weight", *domains], rows, "relative to 50/50; below 1 is better")


def trade_off(rows: Sequence[Sequence[Any]], cases: Mapping[str, str]) -> Picture:
    """Output-domain match over equation-domain match, one curve per case, along the weight."""
    parts: list[Part] = [Rule(look=looks.ZERO, at=1.0), Rule(look=looks.ZERO, at=1.0, axis="y")]
    for i, (case, words) in enumerate(cases.items()):
        own = [row for row in rows if row[0] == case]
        look = replace(looks.each(i, f"{case}: {words}"), dash="-")
        parts.append(Curve(look=look, x=np.array([row[2] for row in own]), y=np.array([row[3] for row in own])))
        parts += [
            Note(text=_ENDS[row[1]], x=row[2], y=row[3], align="center", offset=(0.0, 9.0), colour=look.colour)
            for row in own
            if row[1] in _ENDS
        ]
    panel = Panel(
        parts=tuple(parts),
        x=Axis(label="mismatch in the equation domain / that at 50/50", log=True),
        y=Axis(label="mismatch in the output domain / that at 50/50", log=True),
        height=3.6,
    )
    return Picture(
        name="trade_off",
        figure=Figure(rows=((panel,),)),
        title="Trade-off between the two domains",
        caption="Mean absolute differences from noise-free truth, geometric mean over the channels of a domain; "
        "the weight of the equation part grows along a curve from 'output' (pure output error) to 'equation' (pure "
        "equation error). Where the grey lines cross lies 50/50; below and left of it is better.",
        alt="Curves of output-domain against equation-domain mismatch along the weight.",
    )


def schedule_rows(results: Results, aircraft: Sequence[str], strategies: Mapping[str, str]) -> list[list[Any]]:
    """Rows aircraft, strategy, what it is, right, wrong but claimed, starts, median iterations and error when right."""
    rows = []
    for name in aircraft:
        for strategy, words in strategies.items():
            runs = [r for key, r in results.items() if key.startswith(f"schedule/{name}/{strategy}/")]
            good = [r for r in runs if r["right"]]
            middle = [float(np.median([r[n] for r in good])) if good else None for n in ("iterations", "error")]
            claimed = sum(r["claimed"] and not r["right"] for r in runs)
            rows.append([name, strategy, words, len(good), claimed, len(runs), *middle])
    return rows


SCHEDULE_HEAD = (
    "aircraft",
    "strategy",
    "what",
    "right optimum",
    "wrong but claimed",
    "starts",
    "median iterations",
    "r.m.s. derivative error at its optimum",
)


def statistical_rows(
    results: Results, cases: Sequence[str], noises: Sequence[str], domains: Mapping[str, Sequence[str]]
) -> list[list[Any]]:
    """Rows case, weights, index of every domain relative to weights by range."""
    rows = []
    for case in cases:
        base = means(results, f"statistical/{case}/{noises[0]}/")
        for noise in noises:
            own = means(results, f"statistical/{case}/{noise}/")
            if own and base:
                rows.append([case, noise, *(index(own, n) / index(base, n) for n in domains.values())])
    return rows
