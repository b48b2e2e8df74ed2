"""The report: one self-contained HTML page, and its figures as files beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from casid.arguments import an
from casid.diagnosis.given.account import account_sentence
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.systems.result import SystemDiagnosis
from casid.records.readers import write_record
from casid.report import tables
from casid.report.claims import Claim, claims
from casid.report.envelope import envelope_table
from casid.report.folder import provenance
from casid.report.gained import gained
from casid.report.lead import pictures
from casid.report.next_flight import limited, next_flights
from casid.report.shares import shares
from casid.report.style import Picture
from casid.report.system_page import write_system_report
from casid.report.table import ReportTable
from casid.report.templating import COLOURS, FIGURES, Figure, drawn_into, figures_of, render

# anchor -> title, template, and the figures, in the order of the page
_SECTIONS: Mapping[str, tuple[str, str, tuple[str, ...]]] = MappingProxyType(
    {
        "gain": (
            "What it gains",
            "gain.html",
            ("budget", "gain", "histories", "tracks_longitudinal", "tracks_lateral"),
        ),
        "evidence": (
            "Evidence",
            "figures.html",
            ("wind", "shape", "onset", "bode", "missing_history", "unexplained", "residuals"),
        ),
        "causes": ("Which cause", "causes.html", ("ladder", "ambiguity")),
        "where": ("Where it enters", "figures.html", ("missing", "kinematic", "heatmap")),
        "data": ("Data", "data.html", ("check",)),
        "values": ("Values of the file", "values.html", ("derivatives",)),
        "envelope": ("What was flown", "envelope.html", ("envelope",)),
        "next": ("Next flight", "next_flight.html", ("next_flight",)),
        "numbers": ("Numbers", "numbers.html", ()),
        "unseen": ("What could not be seen with these records", "unseen.html", ()),
        "made": ("How this was made", "made.html", ()),
    }
)


@dataclass(frozen=True, kw_only=True)
class Headline:
    """The verdict as it opens the page: the `badge`, the `causes` where there are several, and the sentence."""

    badge: str
    causes: tuple[str, ...]
    sentence: str


@dataclass(frozen=True, kw_only=True)
class Section:
    """A section of the page: its anchor, title and template, and the figures in it."""

    anchor: str
    title: str
    template: str
    figures: tuple[Figure, ...]


def write_report(
    diagnosis: Diagnosis | SystemDiagnosis, folder: str | Path, made_with: Mapping[str, Any] | None = None
) -> None:
    """Write the page of a diagnosis into a folder.

    These are `report.html`, `report_figures/*.svg` and, of an aircraft, `next_flight*.csv`.

    Parameters
    ----------
    diagnosis
        Of `diagnose`.
    folder
        Where the files go; it is made when it does not exist.
    made_with
        What `run.json` has: command, seed, commit and versions. Default: those of this process.

    Raises
    ------
    InputError
        For what is no diagnosis.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.diagnose("aircraft.toml", cs.read_records("flight/m*.csv"))  # doctest: +SKIP
    >>> cs.write_report(found, "report")  # doctest: +SKIP
    """
    if isinstance(diagnosis, SystemDiagnosis):
        write_system_report(diagnosis, folder, provenance(0) if made_with is None else made_with)
        return
    an(diagnosis, Diagnosis, "write_report: diagnosis", "cs.diagnose(aircraft, records)")
    made_with = provenance(0) if made_with is None else made_with
    following = next_flights(diagnosis)
    shown = pictures(diagnosis) | {one.picture.name: one.picture for one in following.proposals}
    drawn = drawn_into(Path(folder) / FIGURES, _in_order(shown))
    for one in following.proposals:
        write_record(one.record, Path(folder) / f"{one.picture.name}.csv")
    page = render("report.html", _context(diagnosis, drawn, made_with) | {"following": following})
    (Path(folder) / "report.html").write_text(page, encoding="utf-8")


def _in_order(shown: Mapping[str, Picture]) -> dict[str, Picture]:
    """As they stand on the page: the leading one, then section by section."""
    lead = next(iter(shown))
    places = [name for _, _, names in _SECTIONS.values() for name in names]
    return {name: shown[name] for name in (lead, *sorted(set(shown) - {lead}, key=lambda name: _place(name, places)))}


def _place(name: str, places: Sequence[str]) -> tuple[int, str]:
    """Place on the page of a figure; those of further causes stand beside that of the first, `shape-2`."""
    return places.index(name.partition("-")[0]), name


def _context(
    diagnosis: Diagnosis, drawn: Mapping[str, tuple[Picture, bytes]], made_with: Mapping[str, Any]
) -> dict[str, Any]:
    """All that the templates ask for."""
    claimed = claims(diagnosis, drawn)
    figures = figures_of(drawn, _by_figure(claimed))
    return {
        "aircraft": diagnosis.aircraft.name,
        "colour": COLOURS[diagnosis.verdict],
        "account": account_sentence(diagnosis.budget, diagnosis.account, diagnosis.criteria.verdict.stated),
        "headline": _headline(diagnosis),
        "shares": shares(diagnosis),
        "claims": claimed,
        "claim_of": {one.anchor: one for some in claimed.values() for one in some},
        "values_told": _values_told(diagnosis),
        "gained": gained(diagnosis),
        "not_judged": diagnosis.not_judged,
        "facts": _facts(diagnosis),
        "figures": figures,
        "lead": next(iter(figures.values())),
        "sections": _sections(figures),
        "tables": _tables(diagnosis, made_with),
        "trace": diagnosis.trace,
        "minor": [one.sentence for one in diagnosis.minor],
        "remarks": tables.remarks(diagnosis),
    }


def _by_figure(claimed: Mapping[str, Sequence[Claim]]) -> dict[str, list[tuple[str, str]]]:
    """Name of figure -> (anchor, head) of the claims that it shows."""
    found: dict[str, list[tuple[str, str]]] = {}
    for one in (one for some in claimed.values() for one in some):
        for name in one.figures:
            found.setdefault(name, []).append((one.anchor, one.head))
    return found


def _sections(figures: Mapping[str, Figure]) -> list[Section]:
    """A section that is of figures alone is left out where it has none."""
    rest = list(figures.items())[1:]
    every = [
        Section(
            anchor=anchor,
            title=title,
            template=template,
            figures=tuple(figure for name, figure in rest if name.partition("-")[0] in names),
        )
        for anchor, (title, template, names) in _SECTIONS.items()
    ]
    return [one for one in every if one.figures or one.template != "figures.html"]


def _tables(diagnosis: Diagnosis, made_with: Mapping[str, Any]) -> dict[str, ReportTable]:
    return {
        "held_out": tables.channels(diagnosis.held_out_as_given, diagnosis.held_out_extended, diagnosis.best),
        "fitted": tables.channels(diagnosis.as_given, diagnosis.extended, diagnosis.best),
        "causes": tables.causes(diagnosis),
        "alternatives": tables.alternatives(diagnosis),
        "findings": tables.findings(diagnosis.data),
        "derivatives": tables.derivatives(diagnosis),
        "envelope": envelope_table(diagnosis),
        "not_judged": tables.not_judged(diagnosis),
        "limited": limited(diagnosis),
        "unseen": tables.unseen(diagnosis),
        "seconds": tables.seconds(diagnosis),
        "made_with": tables.made_with(made_with),
    }


def _headline(diagnosis: Diagnosis) -> Headline:
    """Several causes become a list, and what follows them the sentence."""
    rest, told = diagnosis.headline, []
    for cause in diagnosis.causes:
        if cause.statement in rest:
            rest = rest.replace(cause.statement, "", 1)
            told.append(cause.statement)
    badge = diagnosis.verdict.capitalize()
    if len(told) < 2:
        return Headline(badge=badge, causes=(), sentence=diagnosis.headline)
    return Headline(badge=badge, causes=tuple(told), sentence=rest.strip())


def _values_told(diagnosis: Diagnosis) -> str:
    told, against = sum(one.determined for one in diagnosis.flight.values()), len(diagnosis.contradicted)
    moved = next((one.what for one in diagnosis.account if one.step == "values"), ())
    largest = f" The largest significant changes: {', '.join(moved[:5])}." if moved else ""
    if not against:
        return (
            f"All {told} numbers of the file that these records identify are consistent with flight within the "
            f"uncertainty that the file states.{largest}"
        )
    return f"{against} of {told} numbers of the file that these records identify are inconsistent with flight.{largest}"


def _facts(diagnosis: Diagnosis) -> str:
    view, held = diagnosis.refitted, diagnosis.held_out_as_given
    fitted = ", ".join(f"{r.name} ({r.duration:.0f} s)" for r in view.fit.flight.records)
    unseen = ", ".join(f"{r.name} ({r.duration:.0f} s)" for r in held.fit.flight.records)
    count = f"{view.samples:,}".replace(",", " ")
    return (
        f"Fitted: {fitted}. Held out: {unseen}. {len(view.channels)} measured channels, {count} readings; "
        f"{sum(diagnosis.flight[o].determined for o in view.fit.derivatives)} derivatives identifiable from them."
    )
