"""The tables of the report."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from casid.data_check.reading import Finding
from casid.diagnosis.cause import NAMED
from casid.diagnosis.document import Document, ReportedCause
from casid.diagnosis.facts import Parameter
from casid.model.vocabulary import KINDS
from casid.report.aircraft_figures import contradicted_first
from casid.report.history_figures import own_unit, simulated
from casid.report.sections import ReportTable, where
from casid.report.statements import about_value
from casid.report.words import channel_scale, digits, percent, pretty, probability_in_words, quantity, with_std

_TOLD = 4  # explanations listed one by one
_SMALLEST = 0.005  # probability, which is told as 1 %


def shares(document: Document) -> list[tuple[str, float]]:
    """Return the most probable explanations, and all others together, with their probabilities, where there are any."""
    others = (one for one in document.explanations[1:_TOLD] if one.probability >= _SMALLEST)
    told = [(_said(one.titles), one.probability) for one in (*document.explanations[:1], *others)]
    rest = 1.0 - sum(probability for _, probability in told)
    return [*told, ("other explanations", rest)] if told and rest >= _SMALLEST else told


def _said(titles: Sequence[str]) -> str:
    return " and ".join(map(pretty, titles)) or "nothing that matters is missing"


def causes(document: Document) -> ReportTable:
    """The named causes, strongest first."""
    rows = [
        {
            "cause": pretty(c.title),
            "size ± 1σ": "\n".join([_size(c), *(f"{k}: {digits(v)}" for k, v in c.parameters.items())]),
            "records": _where(c),
            "probability": "–" if c.probability is None else probability_in_words(c.probability),
            "likelihood-ratio statistic, 2 ln L": digits(c.statistic),
            "gain of log likelihood per reading, held-out records": _held(c),
            "cannot be told apart from": ", ".join(pretty(o["title"]) for o in c.indistinguishable_from) or "–",
        }
        for c in document.causes
    ]
    claims = {k: f"cause-{k + 1}" for k in range(len(rows))}
    return ReportTable.of(rows, "Named causes, strongest first", claims=claims)


def _size(cause: ReportedCause) -> str:
    return with_std(cause.value, cause.std, cause.unit).replace(" ", "\N{NO-BREAK SPACE}")


def _where(cause: ReportedCause) -> str:
    if cause.onset_s:
        ends = {record: f" until {low:.1f}–{high:.1f} s" for record, (low, high) in (cause.end_s or {}).items()}
        return ", ".join(
            f"{r} from {low:.1f}–{high:.1f} s{ends.get(r, '')}" for r, (low, high) in cause.onset_s.items()
        )
    return ", ".join(cause.records)


def _held(cause: ReportedCause) -> str:
    if cause.held_out_gain is None:
        return "an event: judged in its record"
    return f"{2.0 * cause.held_out_gain:+.3f}".replace("-", "−")


def channels(document: Document, held_out: bool) -> ReportTable:
    """Quality of fit per channel, as given and by the best model; r.m.s. in the unit that a person reads."""
    before = document.held_out_as_given if held_out else document.as_given
    after = document.held_out_extended if held_out else document.extended
    quantities = ("r.m.s. error", "Theil", "R²", "whiteness p")
    rows = []
    for name, old in before.channels.items():
        new = after.channels[name]
        own = own_unit(document, name)
        factor, unit = channel_scale(name) if own is None else (1.0, own)
        pairs = [
            (factor * old.rms, factor * new.rms, digits),
            (old.theil, new.theil, _three),
            (old.R2, new.R2, _three),
            (old.whiteness_p, new.whiteness_p, _p),
        ]
        cells = [cell for a, b, show in pairs for cell in (show(a), show(b))]
        rows.append((f"{name} [{unit}]" if unit else name, digits(factor * old.noise, 2), *cells))
    short = "extended" if document.best == "extended model" else "re-estimated"
    return ReportTable(
        head=("channel", "noise 1σ", *(f"{q} {word}" for q in quantities for word in ("as given", short))),
        rows=rows,
        caption=f"{', '.join(before.names)}. {simulated(document)}. Theil: 0 perfect, 1 useless. R²: share "
        "of the variance explained. Whiteness: Ljung–Box on the innovations; small p means that something systematic "
        "is left.",
        numeric=True,
    )


def _three(value: float) -> str:
    if math.isnan(value):
        return "–"
    return digits(value, 3) if abs(value) < 0.1 else f"{value:.3f}".replace("-", "−")


def _p(value: float) -> str:
    return "< 0.001" if value < 1e-3 else f"{value:.2g}"


def findings(found: Sequence[Finding]) -> ReportTable:
    """Faults of the data, with what was done about them."""
    rows = [
        {
            "fault": f"{one.kind.removeprefix('data_').replace('_', ' ')}: {one.target}",
            "records": ", ".join(one.records),
            "when": "; ".join(f"{r} {a:.1f}–{b:.1f} s" for r, parts in one.intervals_s.items() for a, b in parts)
            or "all the time",
            "handled": one.handled,
            "what": pretty(one.sentence),
        }
        for one in found
    ]
    return ReportTable.of(rows, "Faults of the data", claims={k: f"data-{k + 1}" for k in range(len(rows))})


def not_judged(document: Document) -> ReportTable:
    """Tabulate what these records leave open, and why."""
    rows = [{"not judged": one.what, "because": one.because} for one in document.not_judged]
    return ReportTable.of(rows, "What these records leave open")


def alternatives(document: Document) -> ReportTable:
    """Every cause that was fitted and not named, and the gate that it failed."""
    decided = {(one.cause, one.round): one for one in document.trace.decisions}
    rows = []
    for one in document.tried:
        decision = decided.get((one.name, one.round))
        if decision is None or decision.outcome == NAMED:
            continue
        row = {
            "cause": pretty(one.title),
            "round": str(one.round),
            "fitted size": quantity(one.value, one.unit),
            "likelihood-ratio statistic, 2 ln L": digits(one.statistic),
            "why it was not named": document.trace.reason(decision),
        }
        rows.append(row)
    return ReportTable.of(rows, "Alternatives that were fitted, and why they lost")


def unseen(document: Document) -> ReportTable:
    """Smallest effect of every kind that these records would have shown; what would have to be larger than anything
    plausible cannot be seen in them."""
    seen: dict[str, list[str]] = defaultdict(list)
    blind: dict[str, list[str]] = defaultdict(list)
    for one in document.unseen:
        if one.size > one.limit:
            blind[one.kind].append(one.label or "it")
        else:
            seen[one.kind].append(f"{one.label} {quantity(one.size, one.unit)}".strip())
    rows = [
        {
            "kind": kind.replace("_", " "),
            "smallest that would have been found": pretty("; ".join(sorted(seen[kind]))) or "–",
            "not detectable in these records": pretty(", ".join(sorted(blind[kind]))) or "–",
        }
        for kind in dict.fromkeys([*KINDS, *seen, *blind])
        if kind in seen or kind in blind
    ]
    return ReportTable.of(
        rows,
        f"What these records would have shown: sizes of {document.criteria.significance.detectable:.2g}σ, after the "
        "derivatives took their share. Not detectable: it would have to be larger than anything plausible.",
    )


def seconds(document: Document) -> ReportTable:
    """Wall time per stage."""
    spent = {**document.seconds, "together": sum(document.seconds.values())}
    return ReportTable.of([{"stage": stage, "s": f"{s:.1f}"} for stage, s in spent.items()], "Wall time")


def made_with(facts: Mapping[str, Any]) -> ReportTable:
    """Versions, seed, commit and command."""
    versions = ", ".join(f"{name} {number}" for name, number in facts["versions"].items() if number)
    rows = (
        ("versions", f"{versions}, Python {facts['python']}"),
        ("platform", facts["platform"]),
        ("commit", str(facts["commit"] or "–")),
        *([("seed", str(facts["seed"]))] if "seed" in facts else []),
        ("command", " ".join(facts["command"])),
    )
    return ReportTable(head=("", ""), rows=rows, caption="Made with")


def derivatives(document: Document) -> ReportTable:
    """Every number as given, by the records, and how far the two are apart; contradicted ones first."""
    of = document.source
    witness = document.witness
    given = "aircraft file" if document.coefficients else of
    found = sorted(document.parameters, key=lambda one: not one.flight.determined)
    found.sort(key=contradicted_first(document))
    contradicted = {one.parameter for one in document.contradicted}
    against = where(one.flight.determined and one.name in contradicted for one in found)
    told = {k: f"against {witness}" for k in against}
    return ReportTable(
        head=("parameter", given, f"{witness} ± 1σ", "deviation", "in σ", ""),
        rows=[(one.name, *_beside_flight(one), told.get(k, "")) for k, one in enumerate(found)],
        marked=against,
        claims={k: about_value(found[k].name) for k in against},
        caption=f"{'Derivatives per rad. ' if document.coefficients else ''}{witness.capitalize()}: estimates from "
        "the records alone, beside the named causes. 1σ allows for coloured residuals, model discrepancy and "
        f"differences between stretches of record. Inconsistent with {witness}: beyond the uncertainty that the "
        f"{of} states, or a tenth where it states none, and beyond 3σ.",
        numeric=True,
    )


def _beside_flight(one: Parameter) -> tuple[str, str, str, str]:
    """Return a number of the file, that of flight, how far they are apart, and the same over the 1-sigma."""
    says = one.flight
    unit = "1" if one.unit.startswith("1/") else one.unit
    given = with_std(one.a_priori, 0.0, unit)
    if not says.determined:
        return given, "not identifiable from these records", "", ""
    sigmas = digits(abs(says.value - one.a_priori) / says.std, 2) if says.std > 0.0 else "–"
    return given, with_std(says.value, says.std, unit), percent(says.value, one.a_priori, says.std), sigmas
