"""Time histories of the records, measured and simulated, and the residuals between them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from casid.diagnosis.document import Document, Simulated
from casid.diagnosis.first_screen import FirstScreen
from casid.records.record import Record
from casid.report import estimate_figures, looks
from casid.report.figure import TIME, WIDE, Axis, Curve, Figure, Note, Panel, Picture, Span, history, stacked
from casid.report.words import channel_axis, channel_scale, pretty
from casid.signals import label_of

# plane of motion -> inputs and outputs
PLANES = {
    "longitudinal": (("delta_e", "thrust"), ("V", "alpha", "q", "theta", "ax", "az", "qdot", "altitude")),
    "lateral": (("delta_a", "delta_r"), ("beta", "p", "r", "phi", "psi", "ay", "pdot", "rdot")),
}
# inches
_ROW = 0.72
_INPUT_ROW = 0.5
_APART = 1.0  # s between records
_LONGEST = 180.0  # s on one axis
_BEYOND = 3.0  # ranges of the measurement: how far a simulation that diverges is followed
_HELD = looks.Look(name="held out: no fit has seen it", colour="#EAF4EE")
_LEFT_OUT = looks.FAULT.called("samples left out")


@dataclass(frozen=True, eq=False, kw_only=True)
class Piece:
    """A record on the common axis from `begin` [s]: its number in the views `before` and `after`, and whether it was
    held out."""

    record: Record
    begin: float
    number: int
    before: Simulated
    after: Simulated
    held: bool

    @property
    def t(self) -> np.ndarray:
        """(N,) its time on the common axis [s]."""
        return self.record.t - self.record.t[0] + self.begin


def tracks(document: Document) -> Iterator[Picture]:
    """Yield a picture for each plane of motion that was measured."""
    pieces = _pieces(document)
    for plane, (surfaces, channels) in PLANES.items():
        outputs = [name for name in channels if name in document.as_given.outputs]
        inputs = [name for name in surfaces if any(name in one.record for one in pieces)]
        if outputs:
            yield _plane(document, plane, pieces, inputs, outputs)


def _pieces(document: Document) -> list[Piece]:
    """Fitted records, then held-out ones, as many as the axis has room for: held-out ones first, then those that the
    file as given simulates worst."""
    views = (
        (document.as_given, document.extended, False),
        (document.held_out_as_given, document.held_out_extended, True),
    )
    every = [
        Piece(record=record, begin=0.0, number=r, before=before, after=after, held=held)
        for before, after, held in views
        for r, record in enumerate(before.records)
    ]
    chosen: list[Piece] = []
    room = _LONGEST
    for one in sorted(every, key=lambda one: (not one.held, -_wrong(one.before, one.number))):
        if one.record.duration <= room or not chosen:
            chosen.append(one)
            room -= one.record.duration
    found = []
    begin = 0.0
    for one in (one for one in every if one in chosen):
        found.append(replace(one, begin=begin))
        begin += one.record.duration + _APART
    return found


def _wrong(view: Simulated, r: int) -> float:
    noise = np.array([view.channels[o].noise for o in view.outputs])
    return float(np.nanmean(np.minimum(np.abs(view.residual[:, r] / noise), 1e3)))


def _plane(
    document: Document, plane: str, pieces: Sequence[Piece], inputs: Sequence[str], outputs: Sequence[str]
) -> Picture:
    rows = [*inputs, *outputs]
    panels = [_track(document, name, pieces, name in inputs) for name in rows]
    notes = (
        Note(text=f"{one.record.name}{' (held out)' if one.held else ''}", x=one.begin, bold=True) for one in pieces
    )
    panels[0] = replace(panels[0], parts=(*panels[0].parts, *notes))
    names = ", ".join(one.record.name for one in pieces)
    return Picture(
        name=f"tracks_{plane}",
        figure=Figure(rows=stacked(panels), width=WIDE),
        title=f"Before and after: {plane} motion in all channels",
        caption=f"Open-loop simulation with the recorded inputs (green, on top): the file as given, and the "
        f"{document.best}. What the blue line still misses of the grey one is not explained.",
        alt=f"Time histories of {', '.join(rows)} in {names}: measured, by the file as given, by the {document.best}.",
    )


def _track(document: Document, name: str, pieces: Sequence[Piece], of_an_input: bool) -> Panel:
    """Return a channel over all records; shaded: what was held out, and what was left out of this channel."""
    spans = []
    for one in pieces:
        if one.held:
            spans.append(Span(look=_HELD, low=one.begin, high=one.begin + one.record.duration))
        shift = one.begin - one.record.t[0]
        for low, high in _left_out(document, name, one.record.name):
            spans.append(Span(look=_LEFT_OUT, low=low + shift, high=high + shift))
    if of_an_input:
        lines = {looks.INPUT: [(one.t, one.record[name]) for one in pieces if name in one.record]}
    else:
        lines = {
            looks.MEASURED: [(one.t, one.record[name]) for one in pieces],
            looks.GIVEN: [(one.t, _simulated(one, one.before, name)) for one in pieces],
            looks.EXTENDED.called(document.best): [(one.t, _simulated(one, one.after, name)) for one in pieces],
        }
    factor = channel_scale(name)[0]
    joint = {look: joined(parts) for look, parts in lines.items()}
    curves = [Curve(look=look, x=t, y=factor * values) for look, (t, values) in joint.items()]
    x = Axis(label="time, records one after the other [s]")
    y = Axis(label=channel_axis(name))
    panel = Panel(parts=(*spans, *curves), x=x, y=y, height=_INPUT_ROW if of_an_input else _ROW)
    return panel if of_an_input else _followed(panel)


def _simulated(one: Piece, view: Simulated, name: str) -> np.ndarray:
    return view.output[: len(one.record), one.number, view.outputs.index(name)]


def _followed(panel: Panel) -> Panel:
    """Let a panel of three curves, measured, as given, and after, follow the one as given only as far as the
    measurement can be read beside it."""
    measured, given, after = (one.y[np.isfinite(one.y)] for one in panel.of(Curve))
    inside = np.concatenate([measured, after])
    if not len(given) or not len(inside):
        return panel
    margin = _BEYOND * float(np.ptp(inside))
    low = float(inside.min()) - margin
    high = float(inside.max()) + margin
    ends = {"low": low if given.min() < low else None, "high": high if given.max() > high else None}
    return replace(panel, y=replace(panel.y, **ends)) if margin else panel


def _left_out(document: Document, name: str, record: str) -> list[tuple[float, float]]:
    """Return the intervals [s] of a channel in a record that take no part."""
    found = [one for one in document.data if name in one.target.split("+") and one.handled == "excluded"]
    return [interval for one in found for interval in one.intervals_s.get(record, ())]


_DEPARTED = 1e9  # standard deviations of noise: further away is no more telling
_WINDOW = 14.0  # s
_RECORDS = 4  # held-out records of a system that are drawn
_FLOWN = 0.9  # of the samples of a simulation that does not diverge; the others are left out of the fit


def misfit(view: Simulated) -> dict[str, float]:
    """Channel -> r.m.s. of the free simulation's residual over the instrument's noise."""
    return {name: c.rms / c.noise for name, c in view.channels.items()}


def histories(document: Document) -> Picture:
    """Measured, as given and by the best model in one held-out record."""
    before = document.held_out_as_given
    after = document.held_out_extended
    old = misfit(before)
    new = misfit(after)
    channels = sorted(old, key=lambda o: new[o] - old[o])[:3]
    r = worst_record(before, channels)
    record = before.records[r]
    window = telling_window(before, after, channels, r)
    panels = [compared(document, channel, r, window, held_out=True) for channel in channels]
    names = ", ".join(label_of(c) for c in channels)
    whole = window == slice(0, len(record))
    part = "" if whole else f"{_WINDOW:.0f} s in which the two simulations differ most. "
    return Picture(
        name="histories",
        figure=Figure(rows=stacked(panels)),
        title=f"Flown again: record {record.name}, which no fit has seen",
        caption="Open-loop simulation with the recorded control inputs, against the measurement: by the file as given, "
        f"from the state that fits the first seconds best, and by the {document.best}. {part}The channels that "
        "differ most.",
        alt=f"Time histories of {names} in held-out record {record.name}: measured, simulated by the file as given, "
        f"and by the {document.best}.",
    )


def worst_channel(document: Document) -> Picture | None:
    """Return the channel with the largest error as given, in the held-out record where it is worst."""
    names = document.budget.worst()
    if not names:
        return None
    channel = names[0]
    before = document.held_out_as_given
    r = worst_record(before, [channel])
    record = before.records[r]
    panel = _followed(compared(document, channel, r, slice(0, len(record)), held_out=True))
    label = document.budget.labels.get(channel, channel)
    return Picture(
        name="worst",
        figure=Figure(rows=((replace(panel, height=2.0),),), width=WIDE),
        title=f"The worst channel: {label} in {record.name}, which no fit has seen",
        caption=pretty(f"{FirstScreen.of(document).worst}. {simulated(document)}."),
        alt=f"Time history of {label} in {record.name}: measured, by the file as given, and by the {document.best}.",
    )


def compared(document: Document, channel: str, r: int, window: slice, *, held_out: bool = False) -> Panel:
    """Return a channel in a part of a record: measured, as given and by the best model."""
    before = document.held_out_as_given if held_out else document.as_given
    after = document.held_out_extended if held_out else document.extended
    record = before.records[r]
    i = before.outputs.index(channel)
    curves = {
        looks.MEASURED: record[channel][window],
        looks.GIVEN: before.output[window, r, i],
        looks.EXTENDED.called(document.best): after.output[window, r, i],
    }
    unit = own_unit(document, channel)
    title = label_of(channel) if unit is None else ""
    return history(channel, record.t[window], curves, title=title, height=1.6, unit=unit)


def own_unit(document: Document, channel: str) -> str | None:
    """Return the unit of a channel of a system, "" for none; None of an aircraft, whose channels are known by name."""
    return None if document.coefficients or document.aircraft else document.as_given.units.get(channel, "")


def simulated(document: Document) -> str:
    """Say what is beside a measurement: no simulation follows a multirotor, which its controller keeps in flight."""
    predicted = document.aircraft and not document.coefficients
    return (
        "Each reading as predicted from those before it"
        if predicted
        else "Open-loop simulation with the recorded inputs"
    )


def flown_again(document: Document) -> Iterator[Picture]:
    """Every output and input of a system in the first held-out records: measured, and by the three models."""
    given = document.held_out_as_given
    views = {"as given": given, "re-estimated": document.held_out_refitted, "extended": document.held_out_extended}
    for r, record in enumerate(given.records[:_RECORDS]):
        outputs = [name for name in given.outputs if name in record]
        inputs = {name: record[name] for name in given.inputs}
        at = given.index(outputs)
        flown = {label: view.output[: len(record), r][:, at] for label, view in views.items()}
        curves = {label: one for label, one in flown.items() if np.isfinite(one).mean() > _FLOWN}
        units = {name: own_unit(document, name) for name in (*outputs, *inputs)}
        picture = estimate_figures.histories(
            record.name, record.t, outputs, record.matrix(outputs), curves, inputs, given="as given", units=units
        )
        yield replace(
            picture,
            name=f"again-{r + 1}",
            title=f"{record.name}, which no fit has seen: measured and simulated",
            caption="Measured outputs, the model as given, with its parameters re-estimated, and extended by the named "
            f"causes; below the inputs: {', '.join(inputs) or 'none'}. A model that diverges is not drawn.",
        )


def telling_window(before: Simulated, after: Simulated, channels: list[str], r: int, seconds: float = _WINDOW) -> slice:
    """The seconds of record r in which the simulations differ most, or without an extension, miss most."""
    record = before.records[r]
    wrong, extended, given = (
        _over_noise(values[: len(record), r], before, channels)
        for values in (before.residual, after.output, before.output)
    )
    moved = extended - given
    size = np.sum((moved if moved.any() else wrong) ** 2, axis=1)
    count = int(seconds / record.dt)
    if count >= len(record):
        return slice(0, len(record))
    total = np.convolve(size, np.ones(count), mode="valid")
    start = int(np.argmax(total))
    return slice(start, start + count)


def worst_record(view: Simulated, channels: list[str]) -> int:
    """The record in which these channels are furthest from their simulation, in units of the noise."""
    seen = np.isfinite(view.residual[..., view.index(channels)])
    total = np.sum(_over_noise(view.residual, view, channels) ** 2, axis=(0, 2))
    return int(np.argmax(total / np.maximum(seen.sum(axis=(0, 2)), 1)))


def _over_noise(values: np.ndarray, view: Simulated, channels: list[str]) -> np.ndarray:
    """(..., channels) of values (..., outputs) over the noise, to compute with: nothing for what is missing, a large
    number for a simulation that has departed."""
    noise = np.array([view.channels[c].noise for c in channels])
    large = np.nan_to_num(values[..., view.index(channels)] / noise, nan=0.0, posinf=_DEPARTED, neginf=-_DEPARTED)
    return np.clip(large, -_DEPARTED, _DEPARTED)


def residuals(document: Document) -> Picture:
    """Residual over its noise in a fitted record, of the channels that the extended model improves most: before
    (re-estimated where causes were found: what new values explain does not point to a cause), what the causes explain
    of it, and what is left."""
    before = document.refitted if document.causes else document.as_given
    after = document.extended
    wrong_by = "re-estimated model" if document.causes else "file as given"
    drop = np.sum(before.white**2 - after.white**2, axis=(0, 1))  # of the innovations, by which the channels are chosen
    channels = [before.outputs[i] for i in np.argsort(-drop)[:3]]
    r = worst_record(before, channels)
    record = before.records[r]
    drawn = {
        replace(looks.GIVEN, name=f"error of the {wrong_by}", dash="-"): before.residual,
        looks.EXPLAINED.called(f"explained by the {document.best}"): after.output - before.output,
        looks.EXTENDED.called("left after it"): after.residual,
    }
    panels = []
    for channel in channels:
        at = slice(len(record)), r, before.outputs.index(channel)
        noise = before.channels[channel].noise
        curves = [
            Curve(look=look, x=record.t, y=smooth(values[at] / noise, record.dt)) for look, values in drawn.items()
        ]
        parts = (Span(look=looks.NOISE, low=-1.0, high=1.0, axis="y"), *curves)
        title = f"{label_of(channel)} {channel}"
        panels.append(Panel(parts=parts, x=TIME, y=Axis(label="residual / σ"), title=title, height=1.6))
    return Picture(
        name="residuals",
        figure=Figure(rows=stacked(panels)),
        title=f"What the {wrong_by} gets wrong, in units of the noise (record {record.name})",
        caption="Measured minus simulated over the instrument's 1σ, smoothed over 0.1 s. What stays inside the grey "
        "band is noise.",
        alt=f"Residuals of {', '.join(channels)} in record {record.name} over a grey noise band, what the "
        f"{document.best} explains of them, and what is left.",
    )


def joined(pieces: Iterable[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Return curves one after the other as one, with a gap between them."""
    x: list[np.ndarray] = []
    y: list[np.ndarray] = []
    for t, values in pieces:
        x += [t, t[-1:] + 1e-6 * max(1.0, abs(float(t[-1])))]
        y += [values, np.array([np.nan])]
    return np.concatenate(x[:-1]), np.concatenate(y[:-1])


def smooth(values: np.ndarray, dt: float, width_s: float = 0.1) -> np.ndarray:
    """Return the Gaussian mean of 1-sigma width `width_s`, over what is not NaN."""
    half = int(np.ceil(3.0 * width_s / dt))
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) * dt / width_s) ** 2)
    seen = np.isfinite(values)
    weight = np.convolve(seen, kernel)[half : half + len(values)]
    total = np.convolve(np.where(seen, values, 0.0), kernel)[half : half + len(values)]
    return np.where(weight > 1e-6, total / np.maximum(weight, 1e-6), np.nan)
