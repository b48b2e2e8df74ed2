"""All channels of all records on one time axis: measured, by the file as given and by the best model, with the inputs.

Records stand one after the other; those that no fit has seen are marked, and samples that are left out are shaded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from casid.diagnosis.flight.view import View
from casid.diagnosis.result import Diagnosis
from casid.records.record import Record
from casid.report.style import (
    ALERT,
    BASELINE,
    EXPLAINED,
    EXTENDED,
    MEASURED,
    WIDE,
    Picture,
    blank,
    channel_scale,
    settings,
)

PLANES: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = MappingProxyType(
    {
        "longitudinal": (("delta_e", "thrust"), ("V", "alpha", "q", "theta", "ax", "az", "qdot", "altitude")),
        "lateral": (("delta_a", "delta_r"), ("beta", "p", "r", "phi", "psi", "ay", "pdot", "rdot")),
    }
)
_ROW, _INPUT_ROW = 0.62, 0.5  # inches
_APART = 1.0  # s between records
_LONGEST = 180.0  # s on one axis
_POINTS = 1500  # of a line over all records: more than its pixels
_BEYOND = 3.0  # ranges of the measurement: how far a simulation that diverges is followed
_HELD = "#EAF4EE"


@dataclass(frozen=True, eq=False, kw_only=True)
class Piece:
    """A record on the common axis from `begin` [s]: its number in the views `before` and `after`, and whether it was
    held out."""

    record: Record
    begin: float
    number: int
    before: View
    after: View
    held: bool

    @property
    def t(self) -> np.ndarray:
        """(N,) its time on the common axis [s]."""
        return self.record.t - self.record.t[0] + self.begin


def tracks(diagnosis: Diagnosis) -> list[Picture]:
    """One picture for each plane of motion that was measured."""
    pieces = _pieces(diagnosis)
    with settings():
        found = [_plane(diagnosis, name, pieces) for name in PLANES]
    return [picture for picture in found if picture is not None]


def _pieces(diagnosis: Diagnosis) -> list[Piece]:
    """Fitted records, then held-out ones, as many as the axis has room for: held-out ones first, then those that the
    file as given simulates worst."""
    views = (
        (diagnosis.as_given, diagnosis.extended, False),
        (diagnosis.held_out_as_given, diagnosis.held_out_extended, True),
    )
    every = [(before, after, r, held) for before, after, held in views for r in range(len(before.records))]
    chosen, room = set(), _LONGEST
    for k in sorted(range(len(every)), key=lambda k: (not every[k][3], -_wrong(every[k][0], every[k][2]))):
        length = every[k][0].fit.flight.records[every[k][2]].duration
        if length <= room or not chosen:
            chosen.add(k)
            room -= length
    found, begin = [], 0.0
    for before, after, r, held in (every[k] for k in sorted(chosen)):
        record = before.fit.flight.records[r]
        found.append(Piece(record=record, begin=begin, number=r, before=before, after=after, held=held))
        begin += record.duration + _APART
    return found


def _wrong(view: View, r: int) -> float:
    noise = np.array([view.channels[o].noise for o in view.fit.model.outputs])
    return float(np.nanmean(np.minimum(np.abs(view.simulated.residual[:, r] / noise), 1e3)))


def _plane(diagnosis: Diagnosis, plane: str, pieces: Sequence[Piece]) -> Picture | None:
    surfaces, channels = PLANES[plane]
    measured = diagnosis.as_given.fit.model.outputs
    shown = [name for name in channels if name in measured]
    inputs = [name for name in surfaces if any(name in one.record for one in pieces)]
    if not shown:
        return None
    rows = [*inputs, *shown]
    figure = blank(_INPUT_ROW * len(inputs) + _ROW * len(shown) + 1.1, WIDE)
    heights = [_INPUT_ROW] * len(inputs) + [_ROW] * len(shown)
    axes = figure.subplots(len(rows), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights})[:, 0]
    for axis, name in zip(axes, rows, strict=True):
        _mark(axis, name, pieces, diagnosis)
        (_input if name in inputs else _output)(axis, name, pieces, diagnosis)
        factor, unit = channel_scale(name)
        axis.set_ylabel(f"{name}\n[{unit}]", rotation=0, ha="right", va="center", fontsize=9)
        axis.tick_params(labelsize=8.5)
        axis.locator_params(axis="y", nbins=3)
        axis.margins(x=0.005)
    for one in pieces:
        label = f"{one.record.name}{' (held out)' if one.held else ''}"
        axes[0].annotate(
            label,
            (one.begin, 1.05),
            xycoords=("data", "axes fraction"),
            fontsize=9.5,
            weight="bold",
            annotation_clip=False,
        )
    axes[-1].set_xlabel("time, records one after the other [s]")
    figure.align_ylabels(axes)
    lines = {label: line for axis in axes for line, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    handles, labels = [*lines.values(), Patch(color=_HELD)], [*lines, "held out: no fit has seen it"]
    if any(_left_out(diagnosis, name, one.record.name) for name in rows for one in pieces):
        handles, labels = [*handles, Patch(color=ALERT, alpha=0.4)], [*labels, "samples left out"]
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    names = ", ".join(one.record.name for one in pieces)
    return Picture(
        name=f"tracks_{plane}",
        figure=figure,
        title=f"Before and after: {plane} motion in all channels",
        caption=(
            f"Open-loop simulation with the recorded inputs (green, on top): the file as given, and the "
            f"{diagnosis.best}. What the blue line still misses of the grey one is not explained."
        ),
        alt=f"Time histories of {', '.join(rows)} in {names}: measured, by the file as given, by the {diagnosis.best}.",
        wide=True,
    )


def _mark(axis: Axes, name: str, pieces: Sequence[Piece], diagnosis: Diagnosis) -> None:
    """Shade what was held out, and what was left out of this channel."""
    for one in pieces:
        if one.held:
            axis.axvspan(one.begin, one.begin + one.record.duration, color=_HELD, lw=0)
        for low, high in _left_out(diagnosis, name, one.record.name):
            shift = one.begin - one.record.t[0]
            axis.axvspan(low + shift, high + shift, color=ALERT, alpha=0.4, lw=0)


def _left_out(diagnosis: Diagnosis, name: str, record: str) -> list[tuple[float, float]]:
    """Intervals [s] of a channel in a record that take no part."""
    found = [one for one in diagnosis.data if name in one.target.split("+") and one.handled == "excluded"]
    return [interval for one in found for interval in one.intervals_s.get(record, ())]


def _input(axis: Axes, name: str, pieces: Sequence[Piece], diagnosis: Diagnosis) -> None:
    factor = channel_scale(name)[0]
    for k, one in enumerate(pieces):
        if name in one.record:
            thin = _thin(one.t, pieces)
            axis.plot(one.t[thin], factor * one.record[name][thin], color=EXPLAINED, lw=1.2, label="" if k else "input")


def _output(axis: Axes, name: str, pieces: Sequence[Piece], diagnosis: Diagnosis) -> None:
    factor, low, high = channel_scale(name)[0], np.inf, -np.inf
    for k, one in enumerate(pieces):
        n, i, thin = len(one.record), one.before.fit.model.outputs.index(name), _thin(one.t, pieces)
        t, read = one.t[thin], factor * one.record[name]
        before, after = (factor * view.simulated.output[:n, one.number, i] for view in (one.before, one.after))
        words = ("measured", "file as given", diagnosis.best) if k == 0 else ("", "", "")
        axis.plot(t, read[thin], color="#BDBDBD", lw=3.2, label=words[0])
        axis.plot(t, before[thin], "--", color=BASELINE, lw=1.1, label=words[1])
        axis.plot(t, after[thin], color=EXTENDED, lw=1.1, label=words[2])
        for series in (read, after):
            inside = series[np.isfinite(series)]
            if len(inside):
                low, high = min(low, float(inside.min())), max(high, float(inside.max()))
    _follow(axis, low, high)


def _follow(axis: Axes, low: float, high: float) -> None:
    """Follow a simulation that departs only as far as the measurement can be read beside it."""
    if high > low:
        bottom, top = axis.get_ylim()
        margin = _BEYOND * (high - low)
        axis.set_ylim(max(bottom, low - margin), min(top, high + margin))
    axis.axhline(0.0, color=MEASURED, lw=0.4, alpha=0.5) if low < 0.0 < high else None


def _thin(t: np.ndarray, pieces: Sequence[Piece]) -> slice:
    total = sum(len(one.record) for one in pieces)
    return slice(None, None, max(1, total // _POINTS))
