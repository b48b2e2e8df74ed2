"""The report: one self-contained HTML page, and its figures as files beside it."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from types import MappingProxyType
from typing import Any

from casid.diagnosis.result import Diagnosis
from casid.report import tables
from casid.report.folder import provenance
from casid.report.lead import pictures
from casid.report.style import Picture
from casid.report.words import pretty
from casid.signals import label_of

FIGURES = "report_figures"
_COLOURS: Mapping[str, str] = MappingProxyType(
    {"adequate": "#00694E", "explained": "#005A8F", "partly explained": "#A34700", "unexplained": "#9B2F6B"}
)
_GAIN = ("gain",)
_EVIDENCE = ("missing_history", "wind", "shape", "onset", "histories", "residuals", "heatmap")
_CAUSES = ("ladder", "ambiguity")
_WHERE = ("still_missing", "missing", "kinematic")


def write_report(diagnosis: Diagnosis, folder: str | Path, made_with: Mapping[str, Any] | None = None) -> None:
    """Write `report.html` and `report_figures/*.svg` into `folder`, which is made.

    `made_with` is what `run.json` has; default: this process and the versions it runs.
    """
    made_with = provenance(0) if made_with is None else made_with
    shown = pictures(diagnosis)
    place = Path(folder) / FIGURES
    place.mkdir(parents=True, exist_ok=True)
    for old in place.glob("*.svg"):
        old.unlink()
    drawn = {name: picture.svg() for name, picture in shown.items()}
    for name, svg in drawn.items():
        (place / f"{name}.svg").write_bytes(svg)
    html = {name: _figure(picture, drawn[name]) for name, picture in shown.items()}
    (Path(folder) / "report.html").write_text(_page(diagnosis, html, made_with), encoding="utf-8")


def _figure(picture: Picture, svg: bytes) -> str:
    data = base64.b64encode(svg).decode("ascii")
    return (
        f"<figure id='figure-{picture.name}'><h3>{escape(picture.title)}</h3>"
        f"<img src='data:image/svg+xml;base64,{data}' alt='{escape(picture.alt)}'>"
        f"<figcaption>{escape(picture.caption)}</figcaption></figure>"
    )


def _page(diagnosis: Diagnosis, html: dict[str, str], made_with: Mapping[str, Any]) -> str:
    lead, extended = next(iter(html)), diagnosis.is_extended
    rest = {name: figure for name, figure in html.items() if name != lead}

    def those(names: tuple[str, ...]) -> str:
        return "\n".join(rest[name] for name in names if name in rest)

    held = tables.channels(diagnosis.held_out_as_given, diagnosis.held_out_extended, extended)
    template = Template(files("casid.report").joinpath("page.html").read_text(encoding="utf-8"))
    return template.substitute(
        aircraft=escape(diagnosis.aircraft.name),
        verdict=escape(diagnosis.verdict.capitalize()),
        colour=_COLOURS[diagnosis.verdict],
        sentence=_verdict(diagnosis) + _data(diagnosis),
        gain=escape(gain_sentence(diagnosis)),
        facts=escape(_facts(diagnosis)),
        lead=html[lead],
        gain_section=(those(_GAIN) if extended else "<p>Nothing was added to the model.</p>") + held,
        evidence=those(_EVIDENCE),
        where=those(_WHERE),
        cause_section=tables.causes(diagnosis)
        + those(_CAUSES)
        + tables.alternatives(diagnosis)
        + "<h3>Minor</h3>"
        + tables.minor(diagnosis),
        numbers=tables.channels(diagnosis.as_given, diagnosis.extended, extended) + tables.parameters(diagnosis),
        unseen=_UNSEEN + tables.unseen(diagnosis),
        made=tables.remarks(diagnosis) + tables.seconds(diagnosis) + tables.made_with(made_with),
    )


_UNSEEN = (
    "<p>An effect below the size in the table leaves no trace that could be told from noise. A steady uniform wind, "
    "the scale of a surface (it is its effectiveness) and steady errors that a change of trim imitates cannot be "
    "seen at all.</p>"
)


def gain_sentence(diagnosis: Diagnosis) -> str:
    """What the extension is worth on records that no fit has seen, in a sentence."""
    before, after = diagnosis.held_out_as_given, diagnosis.held_out_extended
    names = ", ".join(before.fit.flight.names)
    if not diagnosis.causes:
        table = {o: c.rms / c.noise for o, c in after.channels.items()}
        worst = max(table, key=lambda o: table[o])
        return (
            f"On {names}, which no fit has seen, the open-loop simulation stays within {table[worst]:.1f} times the "
            f"instrument's noise in every channel (worst: {label_of(worst)})."
        )
    per_sample = f"{(after.log_likelihood - before.log_likelihood) / before.samples:+.2f}".replace("-", "−")
    if diagnosis.turbulence.named:
        return (
            f"On {names}, which no fit has seen, log likelihood per sample changes by {per_sample}; "
            "gusts are new in every record, so that open-loop residuals need not shrink."
        )
    ratio = {o: after.channels[o].rms / c.rms for o, c in before.channels.items()}
    best = sorted(ratio, key=lambda o: ratio[o])[:3]
    told = ", ".join(f"{label_of(o)} {100.0 * (ratio[o] - 1.0):+.0f} %".replace("-", "−") for o in best)
    return (
        f"On {names}, which no fit has seen, the extended model changes the r.m.s. residual by: {told}; "
        f"log likelihood per sample {per_sample}."
    )


def _verdict(diagnosis: Diagnosis) -> str:
    """The verdict's sentence; several causes become a list, and what follows them its last line."""
    rest, items = diagnosis.sentence, []
    for cause in diagnosis.causes:
        if cause.told in rest:
            rest = rest.replace(cause.told, "", 1)
            items.append(cause.told)
    if len(items) < 2:
        return f"<p class='sentence'>{escape(pretty(diagnosis.sentence))}</p>"
    lines = "".join(f"<li>{escape(pretty(item))}</li>" for item in items)
    return f"<ol class='sentence'>{lines}</ol><p class='sentence'>{escape(pretty(rest.strip()))}</p>"


def _data(diagnosis: Diagnosis) -> str:
    """What is wrong with the data, as a list; nothing when nothing is."""
    if not diagnosis.data:
        return ""
    lines = "".join(f"<li>{escape(pretty(one.sentence))}</li>" for one in diagnosis.data)
    return f"<p>Of the data:</p><ul>{lines}</ul>"


def _facts(diagnosis: Diagnosis) -> str:
    view, held = diagnosis.as_given, diagnosis.held_out_as_given
    fitted = ", ".join(f"{r.name} ({r.duration:.0f} s)" for r in view.fit.flight.records)
    unseen = ", ".join(f"{r.name} ({r.duration:.0f} s)" for r in held.fit.flight.records)
    count = f"{view.samples:,}".replace(",", " ")
    return (
        f"Fitted: {fitted}. Held out: {unseen}. {len(view.channels)} measured channels, {count} readings; "
        f"{len(view.fit.derivatives)} derivatives fitted."
    )
