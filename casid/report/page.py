"""The report: one self-contained HTML page, and its figures as files beside it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from pathlib import Path
from types import MappingProxyType
from typing import Any

from casid.arguments import require
from casid.diagnosis.document import Document, ReportedCause
from casid.diagnosis.first_screen import FirstScreen
from casid.diagnosis.result import Diagnosis
from casid.errors import noting
from casid.native.threads import single_threaded
from casid.records.readers import write_record
from casid.report import tables
from casid.report.aircraft_figures import derivatives, envelope, envelope_table
from casid.report.budget_figures import budget
from casid.report.cause_figures import cause_response, missing_history, onset, shape, unexplained_shapes, wind
from casid.report.data_pages import check_figure
from casid.report.evidence_figures import ambiguity, heatmap, kinematic, ladder, missing
from casid.report.figure import Picture
from casid.report.folder import provenance
from casid.report.history_figures import flown_again, histories, residuals, tracks, worst_channel
from casid.report.next_flight import NextFlights, limited, next_flights
from casid.report.rotor_figures import response_of_axes, rotors_from_above
from casid.report.statements import Statement, numbered, statements
from casid.report.tables import shares
from casid.report.templating import COLOURS, FIGURES, Figure, ReportTable, drawn_into, figures_of, render
from casid.report.words import digits

_SAME = 0.005  # a change that is no per cent


@dataclass(frozen=True, kw_only=True)
class Gained:
    """The error of every record, before and after; and the change of every channel that got worse, and of every one
    that got better, worst first."""

    by_record: str
    worse: str
    better: str


def gained(document: Document) -> Gained:
    """Compare the open-loop simulation of the file as given with that of the best model."""
    ratio = document.rms_ratio
    labels = document.budget.labels
    errors = ", ".join(
        f"{one.record}{' (held out)' if one.held_out else ''} {_multiple(one.as_given)} → {_multiple(one.left)}"
        for one in document.budget.by_record
    )
    gusts = " Gusts are new in every record, so that its error need not shrink." if document.turbulent else ""

    def told(channels: Sequence[str]) -> str:
        return ", ".join(
            f"{labels.get(o, o)} {100.0 * (ratio[o] - 1.0):+.0f}\u00a0%".replace("-", "−") for o in channels
        )

    return Gained(
        by_record=f"Times the noise as given, and with the {document.best}: {errors}.{gusts}",
        worse=told([o for o in ratio if ratio[o] > 1.0 + _SAME]),
        better=told([o for o in ratio if ratio[o] < 1.0 - _SAME]),
    )


def _multiple(ratio: float) -> str:
    return digits(ratio, 2) if math.isfinite(ratio) else "∞"


_MOST = 3  # places where something is unexplained that have pictures of their own


def pictures(document: Document, failed: list[str] | None = None) -> dict[str, Picture]:
    """Name -> picture, that of the worst channel first. Those that cannot be drawn are added to `failed`
    with the error; without such a list it is raised."""
    ladder_ = partial(ladder, document)
    ambiguity_ = partial(ambiguity, document)
    worst = partial(worst_channel, document)
    budget_ = partial(budget, document.budget)
    derivatives_ = partial(derivatives, document)
    if not document.coefficients:
        makers = [
            worst,
            partial(rotors_from_above, document),
            partial(response_of_axes, document),
            budget_,
            partial(flown_again, document),
            ladder_,
            ambiguity_,
            derivatives_,
        ]
    else:
        makers = [
            worst,
            *(partial(_of_cause_numbered, document, n) for n in range(1, 1 + len(document.causes))),
            partial(_of_the_unexplained, document),
            budget_,
            partial(tracks, document),
            partial(histories, document),
            partial(residuals, document),
            partial(heatmap, document),
            ladder_,
            ambiguity_,
            partial(missing, document),
            partial(kinematic, document),
            partial(check_figure, document.data, *_before_and_after(document)),
            derivatives_,
            partial(envelope, document),
        ]
    table = dict[str, Picture]()
    for make in makers:
        with noting(failed, make.func.__name__.strip("_")):
            found = make()
            several = [found] if isinstance(found, Picture) or found is None else list(found)
            table |= {picture.name: picture for picture in several if picture is not None}
    return table


def _of_cause_numbered(document: Document, number: int) -> Iterator[Picture]:
    """Pictures of one of the strongest causes, named with its number."""
    for picture in _of_cause(document, document.causes[number - 1]):
        if picture is not None:
            yield replace(picture, name=numbered(picture.name, number))


def _of_cause(document: Document, cause: ReportedCause) -> Iterable[Picture | None]:
    if cause.stochastic:
        yield wind(document)
        return
    yield shape(cause)
    yield onset(cause)
    yield cause_response(document, cause)
    if cause.histories:
        yield missing_history(cause.enters, cause.histories, curve=True)


def _of_the_unexplained(document: Document) -> Iterator[Picture]:
    for number, one in enumerate(document.unexplained[:_MOST], 1):
        yield missing_history(one.station, one.histories, curve=False, name=numbered("unexplained", number))
    yield from unexplained_shapes(document.shapes)


def _before_and_after(document: Document):
    """Records as they were recorded, and as they were judged."""
    recorded = (*document.as_given.records, *document.held_out_as_given.records)
    judged = (*document.refitted.records, *document.held_out_refitted.records)
    return recorded, judged


# anchor -> title, template, and the figures, in the order of the page
_SECTIONS: Mapping[str, tuple[str, str, tuple[str, ...]]] = MappingProxyType(
    {
        "account": ("Data, values, structure", "account.html", ()),
        "gain": (
            "What it gains",
            "gain.html",
            ("budget", "histories", "tracks_longitudinal", "tracks_lateral", "again"),
        ),
        "evidence": (
            "Evidence",
            "figures.html",
            ("wind", "shape", "onset", "bode", "missing_history", "unexplained", "unexplained_shape", "residuals"),
        ),
        "causes": ("Which cause", "causes.html", ("ladder", "ambiguity")),
        "where": ("Where it enters", "figures.html", ("missing", "kinematic", "heatmap")),
        "data": ("Data", "data.html", ("check",)),
        "values": ("Values of the {source}", "values.html", ("rotors", "axes", "derivatives")),
        "envelope": ("What was flown", "envelope.html", ("envelope",)),
        "flight": ("Next flight", "next_flight.html", ("next_flight",)),
        "numbers": ("Numbers", "numbers.html", ()),
        "unseen": ("What could not be seen with these records", "unseen.html", ()),
        "made": ("How this was made", "made.html", ()),
    }
)
_OF_AIRCRAFT = ("data", "envelope", "flight")  # sections that no other system has


@dataclass(frozen=True, kw_only=True)
class Section:
    """A section of the page: its anchor, title and template, and the figures in it."""

    anchor: str
    title: str
    template: str
    figures: tuple[Figure, ...]


@single_threaded()
def write_report(
    diagnosis: Diagnosis | Document, folder: str | Path, made_with: Mapping[str, Any] | None = None
) -> list[str]:
    """Write the page of a diagnosis into a folder.

    These are `report.html`, `report_figures/*.svg` and, of an aircraft, `next_flight*.csv`.

    Parameters
    ----------
    diagnosis
        Of `diagnose`, or the document of one.
    folder
        Where the files go; it is made when it does not exist.
    made_with
        What `run.json` has: command, seed, commit and versions. Default: those of this process.

    Returns
    -------
    list of str
        What could not be drawn, with the error; the page lists it too.

    Raises
    ------
    InputError
        For what is no document.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.diagnose("aircraft.toml", cs.read_records("flight/m*.csv"))  # doctest: +SKIP
    >>> cs.write_report(found, "report")  # doctest: +SKIP
    """
    if isinstance(diagnosis, Document):
        document = diagnosis
    else:
        document = require(diagnosis, Diagnosis, "write_report: diagnosis", "cs.diagnose(aircraft, records)").document()
    made_with = provenance() if made_with is None else made_with
    following = NextFlights(proposals=(), beyond=())
    failed = list(document.failed)
    with noting(failed, "next flight"):
        following = next_flights(document)
    shown = pictures(document, failed) | {one.picture.name: one.picture for one in following.proposals}
    drawn = drawn_into(Path(folder) / FIGURES, _in_order(shown), failed)
    for one in following.proposals:
        write_record(one.record, Path(folder) / f"{one.picture.name}.csv")
    page = render("report.html", _context(document, drawn, made_with) | {"following": following, "failed": failed})
    (Path(folder) / "report.html").write_text(page, encoding="utf-8")
    return failed


def unfinished(sentence: str) -> str:
    """The page while its figures are drawn, so that no page of an earlier diagnosis is beside new results."""
    verdict = f"<p>{escape(sentence)}</p>"
    return f"<!doctype html><title>Diagnosis</title>{verdict}<p>The figures are not drawn yet.</p>"


def _in_order(shown: Mapping[str, Picture]) -> dict[str, Picture]:
    """Return the figures in the order of the page: the leading one, then section by section."""
    lead = next(iter(shown), "")
    places = [name for _, _, names in _SECTIONS.values() for name in names]
    return {
        name: shown[name]
        for name in [lead][: len(shown)] + sorted(set(shown) - {lead}, key=lambda n: _place(n, places))
    }


def _place(name: str, places: Sequence[str]) -> tuple[int, str]:
    """Place on the page of a figure; those of further causes stand beside that of the first, `shape-2`."""
    return places.index(name.partition("-")[0]), name


def _context(
    document: Document, drawn: Mapping[str, tuple[Picture, bytes]], made_with: Mapping[str, Any]
) -> dict[str, Any]:
    """All that the templates ask for."""
    claimed = statements(document, drawn)
    figures = figures_of(drawn, _by_figure(claimed))
    return {
        "name": document.name,
        "of_aircraft": bool(document.coefficients),
        "colour": COLOURS[document.verdict],
        "badge": document.verdict.capitalize(),
        "first": FirstScreen.of(document),
        "where": ", ".join(document.budget.records),
        "as_given": _multiple(document.budget.together.as_given),
        "left_noise": _multiple(document.budget.together.structure),
        "next": document.next,
        "opening": document.opening,
        "shares": shares(document),
        "claims": claimed,
        "claim_of": {one.anchor: one for some in claimed.values() for one in some},
        "values_told": document.values_told,
        "moved": [one.sentence for one in (*document.moved, *document.combinations)],
        "gained": gained(document),
        "not_judged": document.not_judged,
        "facts": _facts(document),
        "figures": figures,
        "lead": next(iter(figures.values()), None),
        "sections": _sections(document, figures),
        "tables": _tables(document, made_with),
        "trace": document.trace,
        "minor": [one.sentence for one in document.minor],
        "left": document.left,
        "remarks": tables.remarks(document),
    }


def _by_figure(claimed: Mapping[str, Sequence[Statement]]) -> dict[str, list[tuple[str, str]]]:
    """Name of figure -> (anchor, head) of the claims that it shows."""
    found: dict[str, list[tuple[str, str]]] = {}
    for one in (one for some in claimed.values() for one in some):
        for name in one.figures:
            found.setdefault(name, []).append((one.anchor, one.head))
    return found


def _sections(document: Document, figures: Mapping[str, Figure]) -> list[Section]:
    """A section that is of figures alone is left out where it has none, and one of aircraft for other systems."""
    rest = list(figures.items())[1:]
    every = [
        Section(
            anchor=anchor,
            title=title.format(source=document.source),
            template=template,
            figures=tuple(figure for name, figure in rest if name.partition("-")[0] in names),
        )
        for anchor, (title, template, names) in _SECTIONS.items()
        if document.coefficients or anchor not in _OF_AIRCRAFT
    ]
    return [one for one in every if one.figures or one.template != "figures.html"]


def _tables(document: Document, made_with: Mapping[str, Any]) -> dict[str, ReportTable]:
    of_aircraft = {"envelope": envelope_table, "limited": limited} if document.coefficients else {}
    return {name: make(document) for name, make in of_aircraft.items()} | {
        "held_out": tables.channels(document.held_out_as_given, document.held_out_extended, document.best),
        "fitted": tables.channels(document.as_given, document.extended, document.best),
        "causes": tables.causes(document),
        "alternatives": tables.alternatives(document),
        "findings": tables.findings(document.data),
        "derivatives": tables.derivatives(document),
        "not_judged": tables.not_judged(document),
        "unseen": tables.unseen(document),
        "seconds": tables.seconds(document),
        "made_with": tables.made_with(made_with),
    }


def _facts(document: Document) -> str:
    view = document.refitted
    held = document.held_out_as_given
    fitted = ", ".join(f"{r.name} ({r.duration:.0f} s)" for r in view.records)
    unseen = ", ".join(f"{r.name} ({r.duration:.0f} s)" for r in held.records)
    count = f"{view.samples:,}".replace(",", " ")
    return f"Fitted: {fitted}. Held out: {unseen}. {len(view.channels)} measured channels, {count} readings."
