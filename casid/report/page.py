"""The report: one self-contained HTML page, and its figures as files beside it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from casid.arguments import require, sequence
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
from casid.report.sections import Fragment, Section, pictures_of, shown_parts
from casid.report.statements import Statement, numbered, statements
from casid.report.templating import COLOURS, drawn_into, figures_of, render
from casid.report.words import digits, pretty

FIGURES = "report_figures"
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
        shown = list(pictures(document, failed).values())
        every = _sections(document, shown[1:], following, provenance() if made_with is None else made_with)
        sections = [one for one in every if one.parts]
        return cls(
            document=document, sections=sections, lead=next(iter(shown), None), following=following, failed=failed
        )


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
    drawn = drawn_into(Path(folder) / FIGURES, pictures_of(shown_parts([report.lead, *parts])), failed)
    for one in report.following.proposals:
        write_record(one.record, Path(folder) / f"{one.picture.name}.csv")
    context = _context(report, parts, drawn) | {"failed": failed}
    (Path(folder) / "report.html").write_text(render("report.html", context), encoding="utf-8")
    return failed


def unfinished(sentence: str) -> str:
    """The page while its figures are drawn, so that no page of an earlier diagnosis is beside new results."""
    verdict = f"<p>{escape(sentence)}</p>"
    return f"<!doctype html><title>Diagnosis</title>{verdict}<p>The figures are not drawn yet.</p>"


def _sections(
    document: Document, shown: Sequence[Picture], following: NextFlights, made_with: Mapping[str, Any]
) -> Iterator[Section]:
    """Yield the sections in the order of the page, those of an aircraft for an aircraft alone."""

    def of(*names: str) -> list[Picture]:
        """Pictures in the order of their names; those of further causes stand beside that of the first, `shape-2`."""
        place = {one.name: one.name.partition("-")[0] for one in shown}
        found = [one for one in shown if place[one.name] in names]
        return sorted(found, key=lambda one: (names.index(place[one.name]), one.name))

    of_aircraft = bool(document.coefficients)
    yield Section(name="account", title="Data, values, structure", parts=[Fragment(template="account.html")])
    drawn: list[Any] = [*of("budget", "histories", "tracks_longitudinal", "tracks_lateral", "again")]
    held_out = tables.channels(document.held_out_as_given, document.held_out_extended, document.best)
    if drawn:
        drawn.insert(1, Section(title="Errors of the channels in numbers", parts=[held_out]))
    yield Section(name="gain", title="What it gains", parts=drawn or [held_out])
    causes = ("wind", "shape", "onset", "bode", "missing_history", "unexplained", "unexplained_shape", "residuals")
    yield Section(name="evidence", title="Evidence", parts=of(*causes))
    minor = [pretty(one.sentence) for one in document.minor]
    yield Section(
        name="causes",
        title="Which cause",
        parts=[
            Fragment(template="shares.html"),
            tables.causes(document),
            *of("ladder", "ambiguity"),
            tables.alternatives(document),
            Fragment(template="decisions.html"),
            Section(title="Minor", parts=[minor or "Nothing."], open=True),
        ],
    )
    yield Section(name="where", title="Where it enters", parts=of("missing", "kinematic", "heatmap"))
    if of_aircraft:
        records = (*document.refitted.records, *document.held_out_as_given.records)
        remarks = [f"{r.name}: {note}" for r in records for note in r.notes]
        nothing = "" if document.data else "No fault was found in them."
        told = Section(title="Remarks of the reader", parts=[remarks], open=True)
        yield Section(name="data", title="Data", parts=[nothing, tables.findings(document.data), *of("check"), told])
    values = [*of("rotors", "axes", "derivatives"), tables.derivatives(document)]
    yield Section(name="values", title=f"Values of the {document.source}", parts=values)
    if of_aircraft:
        yield Section(name="envelope", title="What was flown", parts=[*of("envelope"), envelope_table(document)])
        next_ones = Fragment(template="next_flight.html", pictures=tuple(one.picture for one in following.proposals))
        yield Section(name="flight", title="Next flight", parts=[next_ones, limited(document)])
    fitted = tables.channels(document.as_given, document.extended, document.best)
    yield Section(name="numbers", title="Numbers", parts=[fitted])
    below = "An effect below the size in the table leaves no trace that could be distinguished from noise."
    never = (
        " A steady uniform wind, the scale of a surface (it is its effectiveness) and steady errors that a change of "
        "trim imitates cannot be seen at all."
    )
    yield Section(
        name="unseen",
        title="What could not be seen with these records",
        parts=[tables.not_judged(document), below + never * of_aircraft, tables.unseen(document)],
    )
    made = [Fragment(template="failed.html"), tables.seconds(document), tables.made_with(made_with)]
    yield Section(name="made", title="How this was made", parts=made)


def _context(report: Report, parts: Sequence[Any], drawn: Mapping[str, tuple[Picture, bytes]]) -> dict[str, Any]:
    """All that the templates ask for. Statements are linked where their section is there."""
    document = report.document
    anchors = {one.name for one in parts}
    claimed = statements(document, drawn)
    linked = [one for some in claimed.values() for one in some if "account" in anchors]
    figures = figures_of(drawn, _by_figure(linked))
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
        "shares": tables.shares(document),
        "claims": claimed,
        "claim_of": {one.anchor: one for one in linked},
        "values_told": document.values_told,
        "moved": [one.sentence for one in (*document.moved, *document.combinations)],
        "gained": gained(document),
        "not_judged": document.not_judged,
        "facts": _facts(document),
        "figures": figures,
        "lead": figures.get(report.lead.name) if report.lead else None,
        "parts": parts,
        "following": report.following,
        "anchors": anchors,
        "trace": document.trace,
        "left": document.left,
    }


def _by_figure(claimed: Iterable[Statement]) -> dict[str, list[tuple[str, str]]]:
    """Name of figure -> (anchor, head) of the claims that it shows."""
    found: dict[str, list[tuple[str, str]]] = {}
    for one in claimed:
        for name in one.figures:
            found.setdefault(name, []).append((one.anchor, one.head))
    return found


def _facts(document: Document) -> str:
    view = document.refitted
    held = document.held_out_as_given
    fitted = ", ".join(f"{r.name} ({r.duration:.0f} s)" for r in view.records)
    unseen = ", ".join(f"{r.name} ({r.duration:.0f} s)" for r in held.records)
    count = f"{view.samples:,}".replace(",", " ")
    return f"Fitted: {fitted}. Held out: {unseen}. {len(view.channels)} measured channels, {count} readings."
