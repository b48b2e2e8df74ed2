"""Figures and pages of the data alone: faults of the records, manoeuvres, kinematic compatibility."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from casid.data_check.check import DataFindings
from casid.data_check.reading import Finding
from casid.diagnosis.kinematics.compatibility import Compatibility
from casid.records.record import Record
from casid.records.segments import Segment
from casid.report import tables
from casid.report.estimate_figures import file_name, histories
from casid.report.statements import about_data
from casid.report.style import (
    ALERT,
    EXPLAINED,
    MEASURED,
    WIDE,
    Picture,
    channel_axis,
    channel_scale,
    legend,
    settings,
    stacked,
)
from casid.report.templating import ReportTable, Row, write_page
from casid.report.words import digits, pretty, to_noise
from casid.signals import SURFACES, for_a_person, label_of

_MOST = 8  # channels drawn
_HEIGHT = 1.25  # inches per channel
_APART = 1.0  # s between records on the time axis


def check_figure(findings: Sequence[Finding], recorded: Sequence[Record], judged: Sequence[Record]) -> Picture | None:
    """Suspected channels over all records, as recorded in grey, as they should be in green; what a finding says of a
    part of a record is shaded. None when nothing is suspected."""
    there = {name for record in recorded for name in record.channels}
    suspected = [name for name in _suspected(findings) if name in there][:_MOST]
    if not suspected:
        return None
    with settings():
        figure, axes = stacked([_HEIGHT] * len(suspected), WIDE)
        for axis, name in zip(axes, suspected, strict=True):
            concerned = [one for one in findings if name in one.target.split("+")]
            _draw(axis, name, list(zip(recorded, judged, strict=True)), concerned)
        axes[-1].set_xlabel("time, records one after the other [s]")
        legend(figure, axes, 4)
    said = " ".join(one.sentence for one in findings)
    return Picture(
        name="check",
        figure=figure,
        title="Data that are not as they should be",
        caption="Grey: as recorded. Green: as corrected. Shaded: the time that a fault says. Dots: samples left out.",
        alt=said,
        wide=True,
    )


def _suspected(findings: Sequence[Finding]) -> list[str]:
    names = [name for one in findings for name in one.target.split("+") if name != "t"]
    return list(dict.fromkeys(names))


def _draw(axis: Axes, name: str, pairs: Sequence[tuple[Record, Record]], findings: Sequence[Finding]) -> None:
    factor, unit = channel_scale(name)
    begin = 0.0
    said = set[str]()

    def once(word: str) -> str:
        """A word for the legend, the first time that it is wanted."""
        new = "" if word in said else word
        said.add(word)
        return new

    for before, after in pairs:
        shift = begin - before.t[0]
        end = before.t[-1] + shift
        axis.annotate(before.name, (begin, 1.02), xycoords=("data", "axes fraction"), fontsize=9, annotation_clip=False)
        for low, high in (part for one in findings for part in one.intervals_s.get(before.name, ())):
            axis.axvspan(low + shift, high + shift, color=ALERT, alpha=0.3, lw=0.8, label=once("a fault"))
        if name in before:
            t = before.t + shift
            old = factor * before[name]
            axis.plot(t, old, color=MEASURED, alpha=0.45, linewidth=1.0, label=once("recorded"))
            if name in after and len(after) == len(before):
                new = factor * after[name]
                out = np.isfinite(old) & ~np.isfinite(new)
                changed = np.isfinite(new) & (old != new)
                if changed.any():
                    axis.plot(t, np.where(changed, new, np.nan), color=EXPLAINED, label=once("corrected"))
                if out.any():
                    axis.plot(t[out], old[out], ".", color=ALERT, markersize=3.0, label=once("left out"))
        begin = end + _APART
    axis.set_title(label_of(name), loc="right")
    axis.set_ylabel(f"{name} [{unit}]")
    axis.margins(x=0.005)


_SHOWN = (*SURFACES, "p", "q", "r")


def segment_figure(record: Record, found: Sequence[Segment]) -> Picture:
    """Surfaces and rates over the whole record; the manoeuvres are shaded and numbered."""
    names = [name for name in _SHOWN if name in record]
    with settings():
        figure, axes = stacked([1.1] * len(names), WIDE)
        for ax, name in zip(axes, names, strict=True):
            ax.plot(record.t, channel_scale(name)[0] * record[name], color=MEASURED, lw=0.8)
            ax.set_ylabel(channel_axis(name))
            for one in found:
                ax.axvspan(one.start, one.stop, color=EXPLAINED, alpha=0.18, lw=0.0)
            ax.margins(x=0.005)
        for number, one in enumerate(found, 1):
            place = 0.5 * (one.start + one.stop)
            label = f"{number}\n{'+'.join(one.axes)}"
            axes[0].annotate(
                label, (place, 1.02), xycoords=("data", "axes fraction"), ha="center", va="bottom", fontsize=8
            )
        axes[-1].set_xlabel("t [s]")
    return Picture(
        name=f"segments_{file_name(record.name)}",
        figure=figure,
        histories=True,
        title=f"{record.name}: manoeuvres",
        caption="Surfaces and rates of rotation. Shaded and numbered: the manoeuvres that were found.",
        alt=f"{len(found)} manoeuvres in {record.name}.",
        wide=True,
    )


_COLOURS = {True: "#00694E", False: "#A3122A"}


def write_check(found: DataFindings, folder: str | Path) -> None:
    """Write `check.html` and `check_figures/*.svg` into `folder`, which is made."""
    picture = check_figure(found.findings, found.recorded, found.records)
    context = {
        "colour": _COLOURS[found.clean],
        "records": ", ".join(record.name for record in found.recorded),
        "sentences": list(found.sentences),
        "findings": tables.findings(found.findings),
        "channels": _channel_table(found),
        "remarks": [f"{record.name}: {note}" for record in found.recorded for note in record.notes],
    }
    write_page(folder, "check", [picture] if picture else [], context)


def _channel_table(found: DataFindings) -> ReportTable:
    suspected = {name: number for number, one in enumerate(found.findings, 1) for name in one.target.split("+")}
    rows = tuple(
        Row(
            cells=(
                f"{row.name} [{pretty(row.unit)}]",
                *(to_noise(value, row.noise) for value in (row.least, row.median, row.most)),
                digits(row.noise, 2),
                digits(row.rate_hz),
                f"{100.0 * row.missing:.2g} %",
                str(row.records),
            ),
            claim=about_data(suspected[row.name]) if row.name in suspected else "",
            marked=row.name in suspected,
        )
        for row in found.table
    )
    return ReportTable(
        head=("channel", "least", "median", "most", "noise 1σ", "rate [Hz]", "missing", "records"),
        rows=rows,
        caption="Every channel of all records; suspected ones are marked. Noise: what the high band shows as white.",
        numeric=True,
    )


def write_compatibility(found: Compatibility, folder: str | Path) -> None:
    """Write `compatibility.html` and `compatibility_figures/*.svg` into `folder`, which is made."""
    context = {
        "colour": _COLOURS[found.passed],
        "found": found,
        "records": ", ".join(record.name for record in found.records),
        "errors": _errors(found),
        "channels": _channels_left(found),
    }
    write_page(folder, "compatibility", compatibility_figures(found), context)


def compatibility_figures(found: Compatibility) -> list[Picture]:
    """Measured and reconstructed histories of every record."""
    names = list(found.left)
    times = {record.name: record.t for record in found.records}
    return [
        histories(name, times[name], names, measured, {"reconstructed": found.reconstructed[name]})
        for name, measured in found.measured.items()
        if np.isfinite(measured).any()
    ]


def _errors(found: Compatibility) -> ReportTable:
    rows = []
    for one in found.errors:
        factor, unit = for_a_person(one.unit)
        cells = (
            f"{one.kind.removeprefix('sensor_').replace('_', ' ')}: {one.target}",
            "not determined" if one.stated is None else digits(factor * one.stated),
            digits(factor * one.std, 2),
            digits(factor * one.allowed, 2),
            pretty(unit),
            "pass" if one.passed else "FAIL",
        )
        rows.append(Row(cells=cells, marked=not one.passed))
    return ReportTable(
        head=("error", "value", "1σ", "allowed", "unit", "verdict"),
        rows=tuple(rows),
        caption="Errors of the instruments, measured minus true. An error fails that is clear and larger than allowed.",
        numeric=True,
    )


def _channels_left(found: Compatibility) -> ReportTable:
    rows = []
    for name, left in found.left.items():
        rows.append(Row(cells=(name, digits(left, 2))))
    return ReportTable(
        head=("channel", "left over noise"),
        rows=tuple(rows),
        caption="r.m.s. of measured minus reconstructed, over the noise of the channel. Near 1 the measurements agree; "
        "accelerations are followed more closely, because the forces are free.",
        numeric=True,
    )
