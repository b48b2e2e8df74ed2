"""The tables of the report."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from casid.data_check.reading import Finding
from casid.diagnosis.cause import NAMED, Cause
from casid.diagnosis.flight.flight import Flight
from casid.diagnosis.flight.noise import View
from casid.diagnosis.result import Diagnosis
from casid.model.effects import effect_named
from casid.model.vocabulary import KINDS
from casid.report.aircraft_figures import compared
from casid.report.claims import about_cause, about_data, about_value
from casid.report.style import channel_scale
from casid.report.templating import ReportTable, Row
from casid.report.words import digits, effect_name, pretty, probability_in_words, quantity, with_std

_TOLD = 4  # explanations told one by one


@dataclass(frozen=True, kw_only=True)
class Share:
    """What an explanation says, and its probability."""

    what: str
    probability: float

    @property
    def percent(self) -> str:
        """In words."""
        return probability_in_words(self.probability)


def shares(diagnosis: Diagnosis) -> list[Share]:
    """The most probable explanations and all others together; none where there are no probabilities."""
    told = [Share(what=_said(names, diagnosis), probability=p) for names, p in diagnosis.explanations[:_TOLD]]
    told = [one for k, one in enumerate(told) if k == 0 or one.probability >= 0.005]
    rest = 1.0 - sum(one.probability for one in told)
    return [*told, Share(what="other explanations", probability=rest)] if told and rest >= 0.005 else told


def _said(names: Sequence[str], diagnosis: Diagnosis) -> str:
    return " and ".join(title(name, diagnosis) for name in names) if names else "nothing that matters is missing"


def title(name: str, diagnosis: Diagnosis) -> str:
    """Short name of a cause from its name in tables: "actuator_lag(delta_e)" -> "elevator: actuator lag"."""
    considered = {one.name: one for one in diagnosis.bare.flight.effects}
    effect = considered[name] if name in considered else effect_named(name)
    return f"{effect_name(effect)} ({effect.variant})" if effect.variant else effect_name(effect)


def causes(diagnosis: Diagnosis) -> ReportTable:
    """The named causes, strongest first."""
    rows = tuple(
        Row(
            cells=(
                pretty(c.title),
                "\n".join(
                    [
                        _in_one_line(with_std(c.value, c.std, c.unit)),
                        *(f"{k}: {digits(v)}" for k, v in c.parameters.items()),
                    ]
                ),
                _where(c),
                "–" if c.probability is None else probability_in_words(c.probability),
                digits(c.statistic),
                _held(c),
                ", ".join(pretty(o["title"]) for o in c.indistinguishable_from) or "–",
            ),
            claim=about_cause(number),
        )
        for number, c in enumerate(diagnosis.causes, 1)
    )
    head = (
        "cause",
        "size ± 1σ",
        "records",
        "probability",
        "likelihood-ratio statistic, 2 ln L",
        "gain of log likelihood per reading, held-out records",
        "cannot be told apart from",
    )
    return ReportTable(head=head, rows=rows, caption="Named causes, strongest first")


def _in_one_line(text: str) -> str:
    return text.replace(" ", "\N{NO-BREAK SPACE}")


def _where(cause: Cause) -> str:
    if cause.onset_s:
        ends = {record: f" until {low:.1f}–{high:.1f} s" for record, (low, high) in (cause.end_s or {}).items()}
        return ", ".join(
            f"{r} from {low:.1f}–{high:.1f} s{ends.get(r, '')}" for r, (low, high) in cause.onset_s.items()
        )
    return ", ".join(cause.records)


def _held(cause: Cause) -> str:
    if cause.held_out_gain is None:
        return "an event: judged in its record"
    return f"{2.0 * cause.held_out_gain:+.3f}".replace("-", "−")


def channels(before: View, after: View, best: str) -> ReportTable:
    """Quality of fit per channel, by the file as given and by the `best` model; r.m.s. in the unit that a person
    reads."""
    quantities = ("r.m.s. error", "Theil", "R²", "whiteness p")
    rows = []
    for name, old in before.channels.items():
        new = after.channels[name]
        own = not isinstance(before.fit.flight, Flight)
        factor, unit = (1.0, before.fit.model.units.get(name, "")) if own else channel_scale(name)
        pairs = [
            (factor * old.rms, factor * new.rms, digits),
            (old.theil, new.theil, _three),
            (old.R2, new.R2, _three),
            (old.whiteness_p, new.whiteness_p, _p),
        ]
        cells = [cell for a, b, show in pairs for cell in (show(a), show(b))]
        rows.append(Row(cells=(f"{name} [{unit}]" if unit else name, digits(factor * old.noise, 2), *cells)))
    short = "extended" if best == "extended model" else "re-estimated"
    return ReportTable(
        head=("channel", "noise 1σ", *(word for q in quantities for word in (f"{q} as given", short))),
        rows=tuple(rows),
        caption=f"Open-loop simulation of {', '.join(before.fit.flight.names)}. Theil: 0 perfect, 1 useless. R²: share "
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
    rows = tuple(
        Row(
            cells=(
                f"{one.kind.removeprefix('data_').replace('_', ' ')}: {one.target}",
                ", ".join(one.records),
                _when(one) or "all the time",
                one.handled,
                pretty(one.sentence),
            ),
            claim=about_data(number),
        )
        for number, one in enumerate(found, 1)
    )
    return ReportTable(head=("fault", "records", "when", "handled", "what"), rows=rows, caption="Faults of the data")


def _when(one: Finding) -> str:
    return "; ".join(f"{r} {a:.1f}–{b:.1f} s" for r, parts in one.intervals_s.items() for a, b in parts)


def not_judged(diagnosis: Diagnosis) -> ReportTable:
    """What these records leave open, and why."""
    rows = tuple(Row(cells=(one.what, one.because)) for one in diagnosis.not_judged)
    return ReportTable(head=("not judged", "because"), rows=rows, caption="What these records leave open")


def alternatives(diagnosis: Diagnosis) -> ReportTable:
    """Every cause that was fitted and not named, and the gate that it failed."""
    decided = {(one.cause, one.round): one for one in diagnosis.trace.decisions}
    rows = []
    for number, round_ in enumerate(diagnosis.rounds, 1):
        for trial in round_.trials:
            one = trial.candidate.attached
            decision = decided.get((trial.candidate.name, number))
            if decision is None or decision.outcome == NAMED:
                continue
            why = decision.failed[0].words if decision.failed else decision.outcome
            size = quantity(one.values["value"], one.effect.unit)
            rows.append(Row(cells=(effect_name(one.effect), str(number), size, digits(trial.gain.raw), why)))
    return ReportTable(
        head=("cause", "round", "fitted size", "likelihood-ratio statistic, 2 ln L", "why it was not named"),
        rows=tuple(rows),
        caption="Alternatives that were fitted, and why they lost",
    )


def unseen(diagnosis: Diagnosis) -> ReportTable:
    """Smallest effect of every kind that these records would have shown; what would have to be larger than anything
    plausible cannot be seen in them."""
    effects = {effect.name: effect for effect in diagnosis.bare.flight.effects}
    seen: dict[str, list[str]] = {}
    blind: dict[str, list[str]] = {}
    for name, size in diagnosis.detectable.items():
        effect = effects.get(name)
        if effect is None or effect.members:
            continue  # a set of coefficients has no one size
        label = " ".join(part for part in (effect.target, effect.term or "", effect.variant) if part)
        if size > effect.limit:
            blind.setdefault(effect.kind, []).append(label or "it")
        else:
            seen.setdefault(effect.kind, []).append(f"{label} {quantity(size, effect.unit)}".strip())
    rows = tuple(
        Row(
            cells=(
                kind.replace("_", " "),
                pretty("; ".join(sorted(seen.get(kind, [])))) or "–",
                pretty(", ".join(sorted(blind.get(kind, [])))) or "–",
            )
        )
        for kind in dict.fromkeys([*KINDS, *seen, *blind])
        if kind in seen or kind in blind
    )
    sigmas = diagnosis.criteria.significance.detectable
    return ReportTable(
        head=("kind", "smallest that would have been found", "not detectable in these records"),
        rows=rows,
        caption=f"What these records would have shown: sizes of {sigmas:.2g}σ, after the derivatives "
        "took their share. Not detectable: it would have to be larger than anything plausible.",
    )


def seconds(diagnosis: Diagnosis) -> ReportTable:
    """Wall time per stage."""
    total = sum(diagnosis.seconds.values())
    rows = [Row(cells=(stage, f"{s:.1f}")) for stage, s in diagnosis.seconds.items()]
    rows.append(Row(cells=("together", f"{total:.1f}")))
    return ReportTable(head=("stage", "s"), rows=tuple(rows), caption="Wall time")


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
    return ReportTable(head=("", ""), rows=tuple(Row(cells=cells) for cells in rows), caption="Made with")


def remarks(diagnosis: Diagnosis) -> list[str]:
    """What the reader of the records remarked, record by record."""
    held = diagnosis.held_out_as_given
    records = [*diagnosis.refitted.fit.flight.records, *held.fit.flight.records]
    return [f"{r.name}: {note}" for r in records for note in r.notes]


def derivatives(diagnosis: Diagnosis) -> ReportTable:
    """Every number as given, by the records, and how far the two are apart; contradicted ones first."""
    of, witness = diagnosis.part.source, diagnosis.part.witness
    rows = tuple(
        Row(
            cells=(
                one.name,
                one.file,
                one.flight,
                one.deviation,
                one.sigmas,
                f"against {witness}" if one.against else "",
            ),
            claim=about_value(one.name) if one.against else "",
            marked=one.against,
        )
        for one in compared(diagnosis)
    )
    return ReportTable(
        head=(
            "parameter",
            "aircraft file" if diagnosis.of_aeroplane else of,
            f"{witness} ± 1σ",
            "deviation",
            "in σ",
            "",
        ),
        rows=rows,
        caption=f"{'Derivatives per rad. ' if diagnosis.of_aeroplane else ''}{witness.capitalize()}: estimates from "
        "the records alone, beside the named causes. 1σ allows for coloured residuals, model discrepancy and "
        f"differences between stretches of record. Inconsistent with {witness}: beyond the uncertainty that the "
        f"{of} states, or a tenth where it states none, and beyond 3σ.",
        numeric=True,
    )
