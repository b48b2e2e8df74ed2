"""Figures 1-6: matching in both domains, and what each derivative's term contributes, against truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.ticker import MaxNLocator

from casid.report.style import BASELINE, EXPLAINED, EXTENDED, MEASURED, Picture, blank, channel_axis, settings

_COLOURS = {"equation": BASELINE, "output": EXTENDED, "combined": EXPLAINED}
_DASHES = {"equation": (0, (5, 1.5)), "output": (0, (1, 1)), "combined": "-"}


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
    with settings():
        drawing = blank(1.25 * len(truth) + 0.9)
        axes = np.atleast_1d(drawing.subplots(len(truth), 1, sharex=True))
        for place, (key, values) in zip(axes, truth.items(), strict=True):
            place.plot(t, values, color=MEASURED, linewidth=2.2, alpha=0.45, label="truth")
            for estimator, own in estimates.items():
                place.plot(
                    t,
                    own[key],
                    color=_COLOURS[estimator],
                    linestyle=_DASHES[estimator],
                    linewidth=1.2,
                    label=f"{estimator} error",
                )
            place.set_ylabel(labels[key])
        axes[-1].set_xlabel("t [s]")
        handles, words = axes[0].get_legend_handles_labels()
        drawing.legend(handles, words, loc="outside lower center", ncols=4)
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
    columns = 3
    rows = -(-len(truth) // columns)
    with settings():
        drawing = blank(1.9 * rows + 0.8)
        axes = drawing.subplots(rows, columns, squeeze=False).ravel()
        for place, (key, values) in zip(axes, truth.items(), strict=False):
            place.plot(x[key], values, ".", color=MEASURED, markersize=1.5, alpha=0.5, label="truth")
            order = np.argsort(x[key])[[0, -1]]
            for estimator, own in estimates.items():
                place.plot(
                    x[key][order],
                    own[key][order],
                    color=_COLOURS[estimator],
                    linestyle=_DASHES[estimator],
                    label=f"{estimator} error",
                )
            place.set_title("{} due to {}".format(*key.split("_", 1)))
            for axis in (place.xaxis, place.yaxis):
                axis.set_major_locator(MaxNLocator(3))
                axis.set_major_formatter("{x:g}")
        for place in axes[len(truth) :]:
            place.set_visible(False)
        handles, words = axes[0].get_legend_handles_labels()
        drawing.legend(handles, words, loc="outside lower center", ncols=4, markerscale=5)
    alt = "Contribution of each term over its variable: truth as points, estimates as straight lines."
    return Picture(name=name, figure=drawing, title=title, caption=caption, alt=alt)
