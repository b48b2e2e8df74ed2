"""A lag, a delay or an effectiveness as gain and phase: frequency responses of flight and of the simulations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from casid.diagnosis.cause import Cause
from casid.diagnosis.flight.view import View
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from casid.frequency.response import FrequencyResponse, frequency_response
from casid.model.causes import group_channels
from casid.model.effects import effect_of
from casid.records.record import Record
from casid.report.bode_figures import draw_gain_and_phase, frequency_axis
from casid.report.residuals import AS_GIVEN, telling_window, worst_record
from casid.report.style import BASELINE, EXTENDED, MEASURED, WIDE, Picture, blank, channel_axis, channel_scale
from casid.report.words import cause_name
from casid.signals import SURFACES, label_of

_ANSWERS = {"delta_e": "q", "delta_a": "p", "delta_r": "r"}  # the channel that a surface moves first
_LEAST = 10  # usable frequencies, fewer of which are no diagram
_SHOWN = 8.0  # s of a time history


def cause_response(diagnosis: Diagnosis, cause: Cause) -> Picture | None:
    """Gain and phase of flight, of the file as given and of the extended model, beside their time histories.

    All three are estimated in the same way, the models from their simulations with the recorded inputs, so that also a
    cause that is not linear has one. None for a cause that is neither at a surface nor in the time of an instrument,
    and where the records give no response with enough coherence.
    """
    effect = effect_of(cause)
    if effect.transfer is None and not effect.of_a_surface:
        return None
    before, after = diagnosis.as_given, diagnosis.extended
    best: tuple[FrequencyResponse, list[Record]] | None = None
    for surface, output in _pairs(group_channels(effect.target), before.fit.model.outputs):
        flown = _cut(cause, after.fit.flight.records)
        found = _response(flown, surface, output)
        if found is not None and (best is None or found.usable.sum() > best[0].usable.sum()):
            best = found, flown
    if best is None or best[0].usable.sum() < _LEAST:
        return None
    flight, flown = best
    models = {}
    for name, view in ((AS_GIVEN, before), (diagnosis.best, after)):
        records = _cut(cause, [_simulated(view, r, flight.output) for r in range(len(view.records))])
        answered = _response(records, flight.input, flight.output, flight)
        if answered is not None:
            models[name] = answered.response
    return _drawn(diagnosis, cause, flight, models) if diagnosis.best in models else None


def _pairs(channels: Sequence[str], outputs: Sequence[str]) -> Iterator[tuple[str, str]]:
    """(surface, reading) in whose response a cause at one of these channels shows."""
    for channel in channels:
        if channel in SURFACES:
            if _ANSWERS[channel] in outputs:
                yield channel, _ANSWERS[channel]
        elif channel in outputs:
            yield from ((surface, channel) for surface in SURFACES)
            return


def _cut(cause: Cause, records: Sequence[Record]) -> list[Record]:
    """The records that have the cause, from its onset on."""
    kept = [record for record in records if not cause.records or record.name in cause.records]
    onsets = cause.onset_s or {}
    return [r.between(onsets[r.name][1], float(r.t[-1])) if r.name in onsets else r for r in kept]


def _response(
    records: Sequence[Record], surface: str, output: str, like: FrequencyResponse | None = None
) -> FrequencyResponse | None:
    """The response of these records, with the frequencies and windows of another; None where there is none."""
    omega, windows = (like.omega, list(like.windows)) if like is not None else (None, None)
    with np.errstate(over="ignore", invalid="ignore"):
        try:
            return frequency_response(records, surface, output, omega=omega, windows=windows)
        except (InputError, np.linalg.LinAlgError):
            return None


def _simulated(view: View, r: int, output: str) -> Record:
    """A record with what the simulation gives in place of the reading, missing where that is."""
    record = view.fit.flight.records[r]
    series = view.simulated.output[: len(record), r, view.fit.model.outputs.index(output)]
    return record.with_channels(**{output: np.where(np.isfinite(record[output]), series, np.nan)})


def _drawn(diagnosis: Diagnosis, cause: Cause, flight: FrequencyResponse, models: dict[str, np.ndarray]) -> Picture:
    figure = blank(4.4, WIDE)
    axes = figure.subplots(2, 2, width_ratios=[1.15, 1.0])
    draw_gain_and_phase(axes[0, 0], axes[1, 0], flight, models)
    axes[0, 0].sharex(axes[1, 0])
    axes[0, 0].tick_params(labelbottom=False)
    frequency_axis(axes[:, 0], flight)
    _histories(axes[0, 1], axes[1, 1], diagnosis, flight)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    name = cause_name(cause.kind, cause.target, cause.term)
    since = " Only what was flown from the onset on is in it." if cause.onset_s else ""
    return Picture(
        name="bode",
        figure=figure,
        title=f"{name}, as gain and phase",
        caption=f"Left: response of the {label_of(flight.output)} {flight.output} to the {label_of(flight.input)} "
        f"{flight.input} over frequency, estimated alike from flight and from the simulations with the recorded "
        f"inputs. Grey: coherence below 0.6, not to be used. Right: the same in time.{since}",
        alt=f"Bode diagram of {flight.output} to {flight.input}: flight, {', '.join(models)}; and time histories.",
        wide=True,
    )


def _histories(top, bottom, diagnosis: Diagnosis, flight: FrequencyResponse) -> None:
    """The reading above, the surface below, in the most informative part of a record."""
    before, after = diagnosis.as_given, diagnosis.extended
    r = worst_record(before, [flight.output])
    record = before.fit.flight.records[r]
    part = telling_window(before, after, [flight.output], r, _SHOWN)
    t, (factor, _) = record.t[part], channel_scale(flight.output)
    top.plot(t, factor * record[flight.output][part], color=MEASURED, lw=2.6, alpha=0.35)
    for view, colour, dash in ((before, BASELINE, "--"), (after, EXTENDED, "-")):
        series = view.simulated.output[part, r, view.fit.model.outputs.index(flight.output)]
        top.plot(t, factor * series, dash, color=colour, lw=1.3)
    bottom.plot(t, channel_scale(flight.input)[0] * record[flight.input][part], color=MEASURED, lw=1.2)
    for ax, channel in ((top, flight.output), (bottom, flight.input)):
        ax.set_ylabel(channel_axis(channel))
        ax.margins(x=0.01)
    top.set_title(f"record {record.name}", loc="left")
    top.tick_params(labelbottom=False)
    bottom.set_xlabel("time t [s]")
