"""Figures and pages of the data alone: faults of the records, manoeuvres, kinematic compatibility."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from casid.data_check.check import DataFindings
from casid.data_check.reading import Finding
from casid.diagnosis.kinematics.compatibility import Compatibility
from casid.records.record import Record
from casid.records.segments import Segment
from casid.report import looks, tables
from casid.report.estimate_figures import file_name, histories
from casid.report.figure import TIME, WIDE, Axis, Curve, Figure, Note, Panel, Part, Picture, Span, history, stacked
from casid.report.result_page import answer_of_faults, write_result
from casid.report.sections import ReportTable, Section, where
from casid.report.words import channel_axis, channel_scale, digits, pretty, to_noise
from casid.signals import SURFACES, for_a_person, label_of

_MOST = 8  # channels drawn
_HEIGHT = 1.25  # inches per channel
_APART = 1.0  # s between records on the time axis
_RECORDED = replace(looks.MEASURED, name="recorded", width=1.0, alpha=0.5)
_CORRECTED = replace(looks.EXPLAINED, name="corrected", dash="-")
_LEFT_OUT = looks.Look(name="left out", colour=looks.PINK, dash="", marker=".", size=3.0)
_MANOEUVRE = looks.Look(name="a manoeuvre", colour=looks.GREEN, alpha=0.18)


def check_figure(findings: Sequence[Finding], recorded: Sequence[Record], judged: Sequence[Record]) -> Picture | None:
    """Suspected channels over all records, as recorded in grey, as they should be in green; what a finding says of a
    part of a record is shaded. None when nothing is suspected."""
    there = {name for record in recorded for name in record.channels}
    suspected = [name for name in _suspected(findings) if name in there][:_MOST]
    if not suspected:
        return None
    pairs = list(zip(recorded, judged, strict=True))
    panels = [_suspect(name, pairs, [one for one in findings if name in one.target.split("+")]) for name in suspected]
    said = " ".join(one.sentence for one in findings)
    return Picture(
        name="check",
        figure=Figure(rows=stacked(panels), width=WIDE),
        title="Data that are not as they should be",
        caption="Grey: as recorded. Green: as corrected. Shaded: the time that a fault says. Dots: samples left out.",
        alt=said,
    )


def _suspected(findings: Sequence[Finding]) -> list[str]:
    names = [name for one in findings for name in one.target.split("+") if name != "t"]
    return list(dict.fromkeys(names))


def _suspect(name: str, pairs: Sequence[tuple[Record, Record]], findings: Sequence[Finding]) -> Panel:
    """Return a channel over all records, with the names of the records above it."""
    factor = channel_scale(name)[0]
    begin = 0.0
    parts: list[Part] = []
    for before, after in pairs:
        shift = begin - before.t[0]
        parts.append(Note(text=before.name, x=begin))
        for low, high in (part for one in findings for part in one.intervals_s.get(before.name, ())):
            parts.append(Span(look=looks.FAULT, low=low + shift, high=high + shift))
        if name in before:
            t = before.t + shift
            old = factor * before[name]
            parts.append(Curve(look=_RECORDED, x=t, y=old))
            if name in after and len(after) == len(before):
                new = factor * after[name]
                out = np.isfinite(old) & ~np.isfinite(new)
                changed = np.isfinite(new) & (old != new)
                if changed.any():
                    parts.append(Curve(look=_CORRECTED, x=t, y=np.where(changed, new, np.nan)))
                if out.any():
                    parts.append(Curve(look=_LEFT_OUT, x=t[out], y=old[out]))
        begin = float(before.t[-1]) + shift + _APART
    x = Axis(label="time, records one after the other [s]")
    title = label_of(name) if label_of(name) != name else ""
    return Panel(parts=tuple(parts), x=x, y=Axis(label=channel_axis(name)), title=title, height=_HEIGHT)


_SHOWN = (*SURFACES, "p", "q", "r")


def segment_figure(record: Record, found: Sequence[Segment]) -> Picture:
    """Surfaces and rates over the whole record; the manoeuvres are shaded and numbered."""
    names = [name for name in _SHOWN if name in record]
    spans = tuple(Span(look=_MANOEUVRE, low=one.start, high=one.stop) for one in found)
    line = replace(_RECORDED, colour=looks.INK, alpha=1.0)
    panels = []
    for name in names:
        panel = history(name, record.t, {line: record[name]}, x=TIME, height=0.9)
        panels.append(replace(panel, parts=(*spans, *panel.parts)))
    numbers = (Note(text=str(k), x=0.5 * (one.start + one.stop), align="center") for k, one in enumerate(found, 1))
    panels[0] = replace(panels[0], parts=(*panels[0].parts, *numbers))
    return Picture(
        name=f"segments_{file_name(record.name)}",
        figure=Figure(rows=stacked(panels), width=WIDE),
        title=f"{record.name}: manoeuvres",
        caption="Surfaces and rates of rotation. Shaded: the manoeuvres that were found, numbered as their files.",
        alt=f"{len(found)} manoeuvres in {record.name}.",
    )


def write_check(found: DataFindings, folder: str | Path) -> None:
    """Write `check.html` and `check_figures/*.svg` into `folder`, which is made."""
    names = ", ".join(record.name for record in found.recorded)
    badge = "Data at fault" if found.sentences else "Nothing is wrong"
    remarks = [f"{record.name}: {note}" for record in found.recorded for note in record.notes]
    parts = [
        check_figure(found.findings, found.recorded, found.records),
        tables.findings(found.findings),
        _channel_table(found),
        Section(title="Remarks of the reader", parts=(remarks,), open=True),
    ]
    answer = answer_of_faults(badge, found.sentences, "No fault of these data was found.")
    write_result(folder, "check", f"Check of flight data: {names}", answer, parts, "check_figures")


def _channel_table(found: DataFindings) -> ReportTable:
    suspected = _suspected(found.findings)
    rows = [
        {
            "channel": f"{row.name} [{pretty(row.unit)}]",
            "least": to_noise(row.least, row.noise),
            "median": to_noise(row.median, row.noise),
            "most": to_noise(row.most, row.noise),
            "noise 1σ": digits(row.noise, 2),
            "rate [Hz]": digits(row.rate_hz),
            "missing": f"{100.0 * row.missing:.2g} %",
            "records": str(row.records),
        }
        for row in found.table
    ]
    told = "Every channel of all records; suspected ones are marked. Noise: the scatter from sample to sample."
    return ReportTable.of(rows, told, numeric=True, marked=where(row.name in suspected for row in found.table))


def write_compatibility(found: Compatibility, folder: str | Path) -> None:
    """Write `compatibility.html` and `compatibility_figures/*.svg` into `folder`, which is made."""
    air = f"The air moves with {found.moving_air:.2g} m/s r.m.s.; errors are estimated together with it."
    answer = answer_of_faults(
        "Pass" if found.passed else "Fail",
        found.against,
        "The measurements are compatible: no error of an instrument is clear and larger than allowed.",
        [*([air] if found.moving_air else []), *([found.wind.sentence] if found.wind else [])],
    )
    names = list(found.left)
    times = {record.name: record.t for record in found.records}
    figures = [
        histories(name, times[name], names, measured, {"reconstructed": found.reconstructed[name]})
        for name, measured in found.measured.items()
        if np.isfinite(measured).any()
    ]
    parts = [
        _errors(found),
        *figures,
        _channels_left(found),
        Section(title="Not judged", parts=(found.not_judged,), open=True),
    ]
    title = f"Compatibility of the measurements: {', '.join(record.name for record in found.records)}"
    write_result(folder, "compatibility", title, answer, parts, "compatibility_figures")


def _errors(found: Compatibility) -> ReportTable:
    rows = []
    for one in found.errors:
        factor, unit = for_a_person(one.unit)
        row = {
            "error": f"{one.kind.removeprefix('sensor_').replace('_', ' ')}: {one.target}",
            "value": "not determined" if one.stated is None else to_noise(factor * one.stated, factor * one.std),
            "1σ": digits(factor * one.std, 2),
            "allowed": digits(factor * one.allowed, 2),
            "unit": pretty(unit),
            "verdict": "pass" if one.passed else "FAIL",
        }
        rows.append(row)
    told = "Errors of the instruments, measured minus true. An error fails that is clear and larger than allowed."
    return ReportTable.of(rows, told, numeric=True, marked=where(not one.passed for one in found.errors))


def _channels_left(found: Compatibility) -> ReportTable:
    rows = [{"channel": name, "left over noise": digits(left, 2)} for name, left in found.left.items()]
    told = (
        "r.m.s. of measured minus reconstructed, over the noise of the channel. Near 1 the measurements agree; "
        "accelerations are followed more closely, because the forces are free."
    )
    return ReportTable.of(rows, told, numeric=True)
