"""The report: one self-contained HTML page, and its figures as files beside it."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
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
from casid.report.words import cause_name, digits, place, pretty
from casid.signals import label_of

FIGURES = "report_figures"
_COLOURS: Mapping[str, str] = MappingProxyType(
    {
        "adequate": "#00694E",
        "values wrong": "#7A5B00",
        "explained": "#005A8F",
        "partly explained": "#A34700",
        "unexplained": "#9B2F6B",
        "data at fault": "#A3122A",
    }
)
_TOLD = 3  # of a kind that the opening tells one by one
_GAIN = ("budget", "gain")
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
    lead, best = next(iter(html)), diagnosis.best
    rest = {name: figure for name, figure in html.items() if name != lead}

    def those(names: tuple[str, ...]) -> str:
        return "\n".join(rest[name] for name in names if name in rest)

    held = tables.channels(diagnosis.held_out_as_given, diagnosis.held_out_extended, best)
    template = Template(files("casid.report").joinpath("page.html").read_text(encoding="utf-8"))
    return template.substitute(
        aircraft=escape(diagnosis.aircraft.name),
        verdict=escape(diagnosis.verdict.capitalize()),
        colour=_COLOURS[diagnosis.verdict],
        sentence=_verdict(diagnosis),
        opening=_opening(diagnosis),
        facts=escape(_facts(diagnosis)),
        lead=html[lead],
        gain_section=those(_GAIN) + held,
        evidence=those(_EVIDENCE),
        where=those(_WHERE),
        cause_section=tables.causes(diagnosis)
        + those(_CAUSES)
        + tables.alternatives(diagnosis)
        + "<h3>Minor</h3>"
        + tables.minor(diagnosis),
        values=tables.contradicted(diagnosis) + tables.parameters(diagnosis),
        numbers=tables.channels(diagnosis.as_given, diagnosis.extended, best),
        unseen=tables.not_judged(diagnosis) + _UNSEEN + tables.unseen(diagnosis),
        made=tables.findings(diagnosis)
        + tables.remarks(diagnosis)
        + tables.seconds(diagnosis)
        + tables.made_with(made_with),
    )


_UNSEEN = (
    "<p>An effect below the size in the table leaves no trace that could be told from noise. A steady uniform wind, "
    "the scale of a surface (it is its effectiveness) and steady errors that a change of trim imitates cannot be "
    "seen at all.</p>"
)


def _opening(diagnosis: Diagnosis) -> str:
    """What is wrong in data, values and structure, what got better and worse, and what was not judged: a line each."""
    lines = {
        "Data": _several([one.sentence for one in diagnosis.data]) or "No fault was found in them.",
        "Values": _values(diagnosis),
        "Structure": _structure(diagnosis),
        "Unseen data": gain_sentence(diagnosis),
        "Not judged": "; ".join(f"{one.what} ({one.because})" for one in diagnosis.not_judged) or "Nothing.",
    }
    items = "".join(f"<dt>{head}</dt><dd>{escape(pretty(line))}</dd>" for head, line in lines.items())
    return f"<dl class='opening'>{items}</dl>"


def _several(sentences: Sequence[str]) -> str:
    more = f" And {len(sentences) - _TOLD} more." if len(sentences) > _TOLD else ""
    return " ".join(sentences[:_TOLD]) + more


def _values(diagnosis: Diagnosis) -> str:
    told = sum(one.told for one in diagnosis.flight.values())
    against = diagnosis.contradicted
    if not against:
        return f"None of the {told} numbers of the file that these records tell of stands against flight."
    names = ", ".join(one.parameter for one in against)
    return f"{len(against)} of the file's numbers, of {told} that these records tell of, against flight: {names}."


def _structure(diagnosis: Diagnosis) -> str:
    named = "; ".join(cause_name(c.kind, c.target, c.term) for c in diagnosis.causes)
    left = ", ".join(dict.fromkeys(place(one.station) for one in diagnosis.unexplained))
    parts = [f"Missing: {named}." if named else "", f"Unexplained at: {left}." if left else ""]
    return " ".join(part for part in parts if part) or "Nothing of a size that matters is missing."


def gain_sentence(diagnosis: Diagnosis) -> str:
    """What got better and what got worse on records that no fit has seen."""
    steps, ratio = diagnosis.budget.together, diagnosis.rms_ratio
    names = ", ".join(diagnosis.budget.records)
    better = sorted((o for o in ratio if ratio[o] < 1.0), key=lambda o: ratio[o])
    worse = [o for o in ratio if ratio[o] >= 1.0]

    def told(channels: Sequence[str]) -> str:
        return ", ".join(f"{label_of(o)} {100.0 * (ratio[o] - 1.0):+.0f} %".replace("-", "−") for o in channels)

    more = f" and {len(better) - _TOLD} more" if len(better) > _TOLD else ""
    gusts = " Gusts are new in every record, so that open-loop residuals need not shrink."
    return (
        f"On {names} the open-loop error is {digits(steps.as_given, 2)} times the noise as given and "
        f"{digits(steps.structure, 2)} with the {diagnosis.best}. Better: {told(better[:_TOLD]) or 'nothing'}{more}. "
        f"Worse: {told(worse) or 'nothing'}.{gusts if diagnosis.turbulence.named else ''}"
    )


def _verdict(diagnosis: Diagnosis) -> str:
    """The verdict's sentence; several causes become a list, and what follows them its last line."""
    rest, items = diagnosis.headline, []
    for cause in diagnosis.causes:
        if cause.told in rest:
            rest = rest.replace(cause.told, "", 1)
            items.append(cause.told)
    if len(items) < 2:
        return f"<p class='sentence'>{escape(pretty(diagnosis.headline))}</p>"
    lines = "".join(f"<li>{escape(pretty(item))}</li>" for item in items)
    return f"<ol class='sentence'>{lines}</ol><p class='sentence'>{escape(pretty(rest.strip()))}</p>"


def _facts(diagnosis: Diagnosis) -> str:
    view, held = diagnosis.refitted, diagnosis.held_out_as_given
    fitted = ", ".join(f"{r.name} ({r.duration:.0f} s)" for r in view.fit.flight.records)
    unseen = ", ".join(f"{r.name} ({r.duration:.0f} s)" for r in held.fit.flight.records)
    count = f"{view.samples:,}".replace(",", " ")
    return (
        f"Fitted: {fitted}. Held out: {unseen}. {len(view.channels)} measured channels, {count} readings; "
        f"{sum(diagnosis.flight[o].told for o in view.fit.derivatives)} derivatives told by them."
    )
