"""The report: one self-contained HTML page, and its figures as files beside it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from casid.arguments import require, sequence
from casid.diagnosis.document import Document
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
from casid.report.sections import Fragment, Section, pictures_of, shown_parts
from casid.report.statements import numbered, statements
from casid.report.templating import COLOURS, Figure, drawn_into, render
from casid.report.words import digits, pretty

FIGURES = "report_figures"
_MOST = 3  # places where something is unexplained that have pictures of their own
# pictures of evidence in their order; those of further causes stand beside that of the first
_EVIDENCE = ("wind", "shape", "onset", "bode", "missing_history", "unexplained", "unexplained_shape", "residuals")
_SAME = 0.005  # a change that is no per cent


def gained(document: Document) -> str:
    """State the error of every record, in open-loop simulation by the file as given and by the best model."""
    errors = ", ".join(
        f"{one.record}{' (held out)' if one.held_out else ''} {_multiple(one.as_given)} → {_multiple(one.left)}"
        for one in document.budget.by_record
    )
    gusts = " Gusts are new in every record, so that its error need not shrink." if document.turbulent else ""
    return f"Times the noise as given, and with the {document.best}: {errors}.{gusts}"


def lost(document: Document) -> str:
    """State the change of every channel that got worse, worst first."""
    labels = document.budget.labels
    worse = {o: 100.0 * (one - 1.0) for o, one in document.rms_ratio.items() if one > 1.0 + _SAME}
    return ", ".join(f"{labels.get(o, o)} {change:+.0f}\u00a0%" for o, change in worse.items())


def _multiple(ratio: float) -> str:
    return digits(ratio, 2) if math.isfinite(ratio) else "∞"


@dataclass(frozen=True, eq=False, kw_only=True)
class Report:
    """The page of a diagnosis as data: `replace` its sections to leave some out, change their order or add your own.

    Parameters
    ----------
    document
        Content of the diagnosis, with which the page opens.
    sections
        What follows below, in its order.
    lead
        The figure on the first screen.
    following
        Manoeuvres to fly next.
    failed
        What could not be drawn, with the error.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import casid as cs
    >>> found = cs.diagnose("aircraft.toml", cs.read_records("flight/m*.csv"))  # doctest: +SKIP
    >>> report = cs.Report.of(found)  # doctest: +SKIP
    >>> [one.name for one in report.sections][:3]  # doctest: +SKIP
    ['account', 'gain', 'evidence']
    >>> kept = [one for one in report.sections if one.name != "numbers"]  # doctest: +SKIP
    >>> masses = {"what": ["empty", "fuel"], "kg": [12500.0, 2100.0]}
    >>> loading = cs.Section(title="Loading", parts=["Weighed on the day of the flight.", masses])
    >>> cs.write_report(replace(report, sections=[loading, *kept]), "report")  # doctest: +SKIP
    """

    document: Document
    sections: Sequence[Section]
    lead: Picture | None
    following: NextFlights
    failed: Sequence[str]

    @classmethod
    def of(cls, diagnosis: Diagnosis | Document, made_with: Mapping[str, Any] | None = None) -> Report:
        """Return the page that `write_report` writes of a diagnosis, and takes the same.

        Parameters
        ----------
        diagnosis
            Of `diagnose`, or the document of one.
        made_with
            What `run.json` has: command, seed, commit and versions. Default: those of this process.
        """
        if isinstance(diagnosis, Document):
            document = diagnosis
        else:
            write = "cs.diagnose(aircraft, records)"
            document = require(diagnosis, Diagnosis, "write_report: diagnosis", write).document()
        following = NextFlights(proposals=(), beyond=())
        failed = list(document.failed)
        with noting(failed, "next flight"):
            following = next_flights(document)
        leads = (worst_channel,) if document.coefficients else (rotors_from_above, worst_channel)
        lead = next((one for make in leads for one in _made(failed, make, document)), None)
        every = _sections(document, following, failed, provenance() if made_with is None else made_with)
        sections = [one for one in every if one.parts]
        return cls(document=document, sections=sections, lead=lead, following=following, failed=failed)

    @property
    def pictures(self) -> dict[str, Picture]:
        """Name -> picture, in the order of the page."""
        return {one.name: one for one in pictures_of(shown_parts([self.lead, *self.sections]))}


@single_threaded()
def write_report(
    diagnosis: Diagnosis | Document | Report, folder: str | Path, made_with: Mapping[str, Any] | None = None
) -> list[str]:
    """Write the page of a diagnosis into a folder.

    These are `report.html`, `report_figures/*.svg` and, of an aircraft, `next_flight*.csv`.

    Parameters
    ----------
    diagnosis
        Of `diagnose`, the document of one, or a `Report` of it with other sections.
    folder
        Where the files go; it is made when it does not exist.
    made_with
        What `run.json` has: command, seed, commit and versions. Default: those of this process, and of a `Report` its
        own.

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
    report = diagnosis if isinstance(diagnosis, Report) else Report.of(diagnosis, made_with)
    like = 'cs.Section(title="Loading", parts=["A text."])'
    sections = sequence(report.sections, "Report: sections", f"a list like [{like}]")
    parts = shown_parts([require(one, Section, "a section of the page", like) for one in sections])
    failed = list(report.failed)
    figures = drawn_into(Path(folder) / FIGURES, report.pictures.values(), failed)
    for one in report.following.proposals:
        write_record(one.record, Path(folder) / f"{one.picture.name}.csv")
    context = _context(report, parts, figures) | {"failed": failed}
    (Path(folder) / "report.html").write_text(render("report.html", context), encoding="utf-8")
    return failed


def unfinished(sentence: str) -> str:
    """The page while its figures are drawn, so that no page of an earlier diagnosis is beside new results."""
    verdict = f"<p>{escape(sentence)}</p>"
    return f"<!doctype html><title>Diagnosis</title>{verdict}<p>The figures are not drawn yet.</p>"


def _made(failed: list[str], make: Callable[..., Any], *of: Any) -> list[Picture]:
    """Return the pictures that a function makes of something; those that cannot be made are in `failed`."""
    with noting(failed, make.__name__.strip("_")):
        found = make(*of)
        several = [found] if isinstance(found, Picture) else found or ()
        return [one for one in several if one is not None]
    return []


def _of_cause(document: Document, number: int) -> Iterator[Picture]:
    """Pictures of one of the strongest causes, named with its number."""
    cause = document.causes[number - 1]
    found = [wind(document)] if cause.stochastic else [shape(cause), onset(cause), cause_response(document, cause)]
    if cause.histories and not cause.stochastic:
        found.append(missing_history(cause.enters, cause.histories, curve=True))
    return (replace(one, name=numbered(one.name, number)) for one in found if one is not None)


def _of_the_unexplained(document: Document) -> Iterator[Picture]:
    for number, one in enumerate(document.unexplained[:_MOST], 1):
        yield missing_history(one.station, one.histories, curve=False, name=numbered("unexplained", number))
    yield from unexplained_shapes(document.shapes)


def _sections(
    document: Document, following: NextFlights, failed: list[str], made_with: Mapping[str, Any]
) -> Iterator[Section]:
    """Yield the sections in the order of the page, those of an aircraft for an aircraft alone."""
    made = partial(_made, failed)
    of_aircraft = bool(document.coefficients)
    yield Section(name="account", title="Data, values, structure", parts=[Fragment(template="account.html")])
    held_out = tables.channels(document, held_out=True)
    gain: list[Any] = made(budget, document.budget)
    gain.append(Section(title="Errors of the channels in numbers", parts=[held_out]) if gain else held_out)
    of_rotors = (worst_channel, flown_again) if document.aircraft else (flown_again,)  # rotors are seen first
    for make in (histories, tracks) if of_aircraft else of_rotors:
        gain += made(make, document)
    yield Section(name="gain", title="What it gains", parts=gain)
    if of_aircraft:
        evidence = [one for k in range(len(document.causes)) for one in made(_of_cause, document, k + 1)]
        evidence += [*made(_of_the_unexplained, document), *made(residuals, document)]
        evidence.sort(key=lambda one: _EVIDENCE.index(one.name.partition("-")[0]))
        yield Section(name="evidence", title="Evidence", parts=evidence)
    yield Section(
        name="causes",
        title="Which cause",
        parts=[
            Fragment(template="shares.html"),
            tables.causes(document),
            *made(ladder, document),
            *made(ambiguity, document),
            tables.alternatives(document),
            Fragment(template="decisions.html"),
            Section(title="Minor", parts=[[pretty(one.sentence) for one in document.minor] or "Nothing."], open=True),
        ],
    )
    if of_aircraft:
        where = [one for make in (missing, kinematic, heatmap) for one in made(make, document)]
        yield Section(name="where", title="Where it enters", parts=where)
        recorded = (*document.as_given.records, *document.held_out_as_given.records)
        judged = (*document.refitted.records, *document.held_out_refitted.records)
        read = (*document.refitted.records, *document.held_out_as_given.records)
        remarks = [f"{r.name}: {note}" for r in read for note in r.notes]
        nothing = "" if document.data else "No fault was found in them."
        told = Section(title="Remarks of the reader", parts=[remarks], open=True)
        drawn = made(check_figure, document.data, recorded, judged)
        yield Section(name="data", title="Data", parts=[nothing, tables.findings(document.data), *drawn, told])
    values = [one for make in (response_of_axes, derivatives) for one in made(make, document)]
    title = f"Values of the {document.source}"
    yield Section(name="values", title=title, parts=[*values, tables.derivatives(document)])
    if of_aircraft:
        flown = [*made(envelope, document), envelope_table(document)]
        yield Section(name="envelope", title="What was flown", parts=flown)
        next_ones = Fragment(template="next_flight.html", pictures=tuple(one.picture for one in following.proposals))
        yield Section(name="flight", title="Next flight", parts=[next_ones, limited(document)])
    fitted = tables.channels(document, held_out=False)
    yield Section(name="numbers", title="Numbers", parts=[fitted])
    below = "An effect below the size in the table leaves no trace that could be distinguished from noise."
    never = (
        " A steady uniform wind, the scale of a surface (it is its effectiveness) and steady errors that a change of "
        "trim imitates cannot be seen at all."
    )
    unseen = [tables.not_judged(document), below + never * of_aircraft, tables.unseen(document)]
    yield Section(name="unseen", title="What could not be seen with these records", parts=unseen)
    how = [Fragment(template="failed.html"), tables.seconds(document), tables.made_with(made_with)]
    yield Section(name="made", title="How this was made", parts=how)


def _context(report: Report, parts: Sequence[Any], figures: Mapping[str, Figure]) -> dict[str, Any]:
    """All that the templates ask for. Statements are linked where their section is there."""
    document = report.document
    anchors = {one.name for one in parts}
    claimed = statements(document, figures)
    linked = [one for some in claimed.values() for one in some if "account" in anchors]
    shows: dict[str, list[tuple[str, str]]] = {}
    for one in linked:
        for name in one.figures:
            shows.setdefault(name, []).append((one.anchor, one.head))
    return {
        "document": document,
        "of_aircraft": bool(document.coefficients),
        "colour": COLOURS[document.verdict],
        "badge": document.verdict.capitalize(),
        "first": FirstScreen.of(document),
        "where": ", ".join(document.budget.records),
        "as_given": _multiple(document.budget.together.as_given),
        "left_noise": _multiple(document.budget.together.structure),
        "shares": tables.shares(document),
        "claims": claimed,
        "claim_of": {one.anchor: one for one in linked},
        "moved": [one.sentence for one in (*document.moved, *document.combinations)],
        "gained": gained(document),
        "lost": lost(document),
        "facts": _facts(document),
        "figures": figures,
        "shows": shows,
        "lead": figures.get(report.lead.name) if report.lead else None,
        "parts": parts,
        "following": report.following,
        "anchors": anchors,
    }


def _facts(document: Document) -> str:
    view = document.refitted
    held = document.held_out_as_given
    fitted = ", ".join(f"{r.name} ({r.duration:.0f} s)" for r in view.records)
    unseen = ", ".join(f"{r.name} ({r.duration:.0f} s)" for r in held.records)
    count = f"{view.samples:,}".replace(",", " ")
    channels = len(view.channels)
    measured = f"{channels} measured channel{'' if channels == 1 else 's'}"
    return f"Fitted: {fitted}. Held out: {unseen}. {measured}, {count} readings."
