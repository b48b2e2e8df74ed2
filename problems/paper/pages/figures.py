"""Figures 1-6: matching in both domains, and what each derivative's term contributes, against truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from casid.report import looks
from casid.report.figure import TIME, Axis, Curve, Figure, Panel, Picture, stacked
from casid.report.looks import Look
from casid.report.words import channel_axis

_TRUTH = looks.MEASURED.called("truth")
_LOOKS = {
    "equation": Look(name="equation error", colour=looks.ORANGE, dash="--"),
    "output": Look(name="output error", colour=looks.BLUE, dash=":"),
    "combined": Look(name="combined error", colour=looks.GREEN),
}


def histories(
    name: str,
    title: str,
    caption: str,
    t: np.ndarray,
    truth: Mapping[str, np.ndarray],
    estimates: Mapping[str, Mapping[str, np.ndarray]],
    labels: Mapping[str, str],
) -> Picture:
    """Time histories one above the other. truth: name -> (N,); estimates: estimator -> name -> (N,), in the same unit;
    labels: name -> axis."""
    panels = []
    for key, values in truth.items():
        curves = (Curve(look=_LOOKS[estimator], x=t, y=own[key]) for estimator, own in estimates.items())
        parts = (Curve(look=_TRUTH, x=t, y=values), *curves)
        panels.append(Panel(parts=parts, x=TIME, y=Axis(label=labels[key]), height=1.1))
    drawing = Figure(rows=stacked(panels))
    alt = f"Time histories of {', '.join(truth)}: truth and the three estimators."
    return Picture(name=name, figure=drawing, title=title, caption=caption, alt=alt)


def outputs_scaled(motion: np.ndarray, names: Sequence[str]) -> dict[str, np.ndarray]:
    """(N, outputs) in rad, rad/s as degrees by name."""
    return {name: np.degrees(motion[:, i]) for i, name in enumerate(names)}


def output_labels(names: Sequence[str]) -> dict[str, str]:
    return {name: channel_axis(name) for name in names}


def over_variable(
    name: str,
    title: str,
    caption: str,
    x: Mapping[str, np.ndarray],
    truth: Mapping[str, np.ndarray],
    estimates: Mapping[str, Mapping[str, np.ndarray]],
) -> Picture:
    """Each term over its own variable: what is nonlinear in truth is straight in the model; by term."""
    panels = []
    dots = replace(_TRUTH, dash="", marker=".", size=2.0, alpha=0.5)
    for key, values in truth.items():
        ends = np.argsort(x[key])[[0, -1]]
        lines = (
            Curve(look=_LOOKS[estimator], x=x[key][ends], y=own[key][ends]) for estimator, own in estimates.items()
        )
        title = "{} due to {}".format(*key.split("_", 1))
        panels.append(Panel(parts=(Curve(look=dots, x=x[key], y=values), *lines), title=title, height=1.5))
    drawing = Figure(rows=stacked(panels, 3), linked=False)
    alt = "Contribution of each term over its variable: truth as points, estimates as straight lines."
    return Picture(name=name, figure=drawing, title=title, caption=caption, alt=alt)
