"""When it set in: the likelihood over the time of onset."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from casid.diagnosis.cause import Cause
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.fingerprints import fingerprints
from casid.diagnosis.evidence.screening import Screen
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.result import Diagnosis
from casid.model.causes import configuration_change
from casid.report.style import BASELINE, EXTENDED, Picture, blank
from casid.report.words import EVIDENCE, cause_name

_STEP = 0.25  # s
_MAX_RECORDS = 4


def onset(diagnosis: Diagnosis, cause: Cause) -> Picture | None:
    """Statistic of the cause over its time of onset, record by record, from the model that did not have it yet."""
    found = _before_naming(diagnosis, cause)
    if not cause.onset_s or found is None:
        return None
    base, attached = found
    profiles = onset_profiles(base, attached)
    records = [name for name in base.batch.names if name in cause.onset_s][:_MAX_RECORDS]
    figure = blank(1.6 * len(records) + 0.7)
    axes = figure.subplots(len(records), 1, squeeze=False)[:, 0]
    for ax, name in zip(axes, records, strict=True):
        t, statistic = profiles[name]
        low, high = cause.onset_s[name]
        middle = 0.5 * (low + high)
        ax.axvspan(low, high, color=BASELINE, alpha=0.35, lw=0, label="95 % interval of the onset")
        ax.axvline(middle, color=BASELINE, lw=1.2)
        ax.plot(t, statistic, color=EXTENDED, label="evidence, the size being fitted")
        ax.set_title(f"{name}: {middle:.1f} s (between {low:.1f} and {high:.1f} s)", loc="left")
        ax.set_ylim(bottom=0.0)
        ax.set_ylabel("evidence")
    axes[-1].set_xlabel("time of onset t [s]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    times = ", ".join(f"{0.5 * sum(cause.onset_s[n]):.1f} s in {n}" for n in records)
    name = cause_name(cause.kind, cause.target, cause.term)
    return Picture(
        name="onset",
        figure=figure,
        title=f"When it set in: {name}",
        caption="How well the cause explains each record when it is made to begin at the time on the axis. Where the "
        f"curve is flat, nothing happened that could tell the times apart. {EVIDENCE}",
        alt=f"Likelihood over the time of onset of {name}; its peaks lie at {times}.",
    )


def _before_naming(diagnosis: Diagnosis, cause: Cause) -> tuple[FlightFit, Attached] | None:
    """The fit that did not have the cause yet, and the cause as it was named; None for one that was not named."""
    base = diagnosis.bare
    for round_ in diagnosis.rounds:
        if not round_.named:
            break
        winner = round_.leader
        one = winner.candidate.attached
        if one.effect.key == (cause.kind, cause.target, cause.term):
            return base, one
        base = round_.fitted
    return None


def onset_profiles(base: FlightFit, attached: Attached) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Record -> (times of onset [s], statistic of the cause if it began then), from a fit that does not have it."""
    effect = attached.effect
    if effect.members:
        effect = configuration_change(effect.members[0])
    effect = replace(effect, grid=({key: attached.values[key] for key in effect.grid[0]},))
    evidence = weigh(base)
    judge, names = Screen(evidence), base.batch.names
    longest = max(record.duration for record in base.flight.records)
    since = np.arange(_STEP, longest, _STEP)
    prints = fingerprints(evidence, [effect], since)
    table = {}
    for r, record in enumerate(base.flight.records):
        keep = np.eye(len(names))[r][None]
        inside = since < record.duration
        statistic = [judge.score([p], keep)[0] for p, i in zip(prints, inside, strict=True) if i]
        table[record.name] = (record.t[0] + since[inside], np.array(statistic))
    return table
