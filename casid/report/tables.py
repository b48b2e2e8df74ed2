"""The tables of the report, as HTML."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from casid.diagnosis.cause import Cause
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.data.finding import Finding
from casid.diagnosis.flight.view import View
from casid.diagnosis.naming.round import Trial
from casid.diagnosis.naming.size import is_artefact, plausible
from casid.diagnosis.naming.trials import gain_asked
from casid.diagnosis.result import Diagnosis
from casid.model.vocabulary import KINDS
from casid.report.style import channel_scale
from casid.report.words import cause_name, digits, effect_name, pretty, quantity, with_std


def table(head: Sequence[str], rows: Iterable[Sequence[str]], caption: str, numeric: bool = False) -> str:
    """An HTML table of cells that are HTML already; the first column heads its row. "" without rows.

    `numeric`: short cells, none of which may break.
    """
    body = [f"<tr><th scope='row'>{row[0]}</th>{''.join(f'<td>{cell}</td>' for cell in row[1:])}</tr>" for row in rows]
    if not body:
        return ""
    kind = " ".join(word for word, true in (("numeric", numeric), ("many", len(head) > 3)) if true)
    top = "".join(f"<th scope='col'>{cell}</th>" for cell in head)
    return (
        f"<p class='caption'>{caption}</p><div class='wide'><table class='{kind}'>"
        f"<thead><tr>{top}</tr></thead>"
        f"<tbody>{''.join(body)}</tbody></table></div>"
    )


def causes(diagnosis: Diagnosis) -> str:
    """The named causes, strongest first."""
    rows = [
        (
            escape(cause_name(c.kind, c.target, c.term)),
            escape(with_std(c.value, c.std, c.unit)) + _further(c),
            escape(_where(c)),
            digits(c.statistic),
            _held(c),
            escape(", ".join(cause_name(o["kind"], o["target"], o["term"]) for o in c.indistinguishable_from) or "–"),
        )
        for c in diagnosis.causes
    ]
    head = (
        "cause",
        "size ± 1σ",
        "records",
        "gain 2 Δ ln L",
        "gain on held-out, ln L per sample",
        "cannot be told apart from",
    )
    return table(head, rows, "Named causes, strongest first")


def _further(cause: Cause) -> str:
    return "".join(f"<br>{escape(k)}: {digits(v)}" for k, v in cause.parameters.items())


def _where(cause: Cause) -> str:
    if cause.onset_s:
        return ", ".join(f"{r} from {low:.1f}–{high:.1f} s" for r, (low, high) in cause.onset_s.items())
    return ", ".join(cause.records)


def _held(cause: Cause) -> str:
    return "an event: judged in its record" if cause.held_out_gain is None else f"{cause.held_out_gain:+.3f}"


def channels(before: View, after: View, best: str) -> str:
    """Quality of fit per channel, by the file as given and by the `best` model; r.m.s. in the unit that a person
    reads."""
    quantities = ("r.m.s. residual", "Theil", "R²", "whiteness p")
    rows = []
    for name, old in before.channels.items():
        new = after.channels[name]
        factor, unit = channel_scale(name)
        pairs = [
            (factor * old.rms, factor * new.rms, digits),
            (old.theil, new.theil, _three),
            (old.R2, new.R2, _three),
            (old.whiteness_p, new.whiteness_p, _p),
        ]
        cells = [cell for a, b, show in pairs for cell in (show(a), show(b))]
        rows.append((f"{name} [{unit}]", digits(factor * old.noise, 2), *cells))
    short = {"extended model": "ext.", "refitted file": "refitted"}[best]
    head = ("channel", "noise 1σ", *(word for q in quantities for word in (f"{q} as given", short)))
    names = escape(", ".join(before.fit.flight.names))
    return table(
        head,
        rows,
        f"Open-loop simulation of {names}. Theil: 0 perfect, 1 useless. R²: share of the variance explained. "
        "Whiteness: Ljung–Box on the innovations; small p means that something systematic is left.",
        numeric=True,
    )


def _three(value: float) -> str:
    return digits(value, 3) if abs(value) < 0.1 else f"{value:.3f}".replace("-", "−")


def _p(value: float) -> str:
    return "&lt; 0.001" if value < 1e-3 else f"{value:.2g}"


def parameters(diagnosis: Diagnosis) -> str:
    """Every derivative and effect of the aircraft file: there, by flight, and how far the two are apart."""
    contradicted, rows = {one.parameter for one in diagnosis.contradicted}, []
    for one in diagnosis.parameters:
        says, given = one.flight, one.a_priori
        if not says.told:
            rows.append((escape(one.name), digits(given), "not told by these records", "", "", ""))
            continue
        apart = says.value - given
        percent = f"{100.0 * apart / given:+.0f} %".replace("-", "−") if given else "–"
        sigmas = digits(abs(apart) / says.std, 2) if says.std > 0.0 else "–"
        mark = "<b>contradicted</b>" if one.name in contradicted else ""
        rows.append((escape(one.name), digits(given), with_std(says.value, says.std, "1"), percent, sigmas, mark))
    head = ("parameter", "aircraft file", "flight ± 1σ", "deviation", "in σ", "")
    return table(
        head,
        rows,
        "Derivatives per rad, effects in SI units. Flight: what the records say by themselves, beside the causes that "
        "were found; the 1σ allows for coloured residuals, small terms of the structure and stretches of record that "
        "disagree. Contradicted: beyond the uncertainty that the file states, or a tenth where it states none, and "
        "beyond 3σ.",
        numeric=True,
    )


def contradicted(diagnosis: Diagnosis) -> str:
    """What of the file stands against flight, worst first, a sentence each; "" when nothing does."""
    items = "".join(f"<li>{escape(pretty(one.sentence))}</li>" for one in diagnosis.contradicted)
    return f"<ol>{items}</ol>" if items else ""


def findings(diagnosis: Diagnosis) -> str:
    """Faults of the data, with what was done about them; "" when there are none."""
    rows = [
        (
            escape(f"{one.kind.removeprefix('data_').replace('_', ' ')}: {one.target}"),
            escape(", ".join(one.records)),
            escape(_when(one) or "all the time"),
            one.handled,
            escape(pretty(one.sentence)),
        )
        for one in diagnosis.data
    ]
    return table(("fault", "records", "when", "handled", "what"), rows, "Faults of the data")


def _when(one: Finding) -> str:
    return "; ".join(f"{r} {a:.1f}–{b:.1f} s" for r, parts in one.intervals_s.items() for a, b in parts)


def not_judged(diagnosis: Diagnosis) -> str:
    """What these records leave open, and why; "" when nothing is."""
    rows = [(escape(one.what), escape(one.because)) for one in diagnosis.not_judged]
    return table(("not judged", "because"), rows, "What these records leave open")


def alternatives(diagnosis: Diagnosis) -> str:
    """Every cause that was fitted and not named, and why it lost."""
    named = {(c.kind, c.target, c.term) for c in diagnosis.causes}
    rows = []
    for number, round_ in enumerate(diagnosis.rounds, 1):
        winner = round_.leader if round_.named else None
        for trial in round_.trials:
            one = trial.candidate.attached
            if trial is winner:
                continue
            later = " (named in another round)" if one.effect.key in named else ""
            doubted = round_.doubt if trial is round_.leader else ""
            rows.append(
                (
                    escape(effect_name(one.effect)),
                    str(number),
                    escape(quantity(one.values["value"], one.effect.unit)),
                    digits(trial.gain.raw),
                    escape((doubted or _why(trial, winner, trial in round_.equivalents, diagnosis.criteria)) + later),
                )
            )
    head = ("cause", "round", "fitted size", "gain 2 Δ ln L", "why it was not named")
    return table(head, rows, "Alternatives that were fitted, and why they lost")


def _why(trial: Trial, winner: Trial | None, equivalent: bool, criteria: Criteria) -> str:
    if trial.refuted:
        return "refuted: the kinematics contradict an error of this size"
    if not trial.meaningful:
        one = trial.candidate.attached
        possible = plausible(one) and not is_artefact(one, trial.share, criteria.size)
        return "too small to matter, or to be certain" if possible else "of no plausible size"
    if equivalent:
        return "cannot be told apart from the one that was named"
    if trial.gain.raw <= 0.0:
        return "explains nothing when it is fitted"
    if winner is not None and trial.gain.raw > winner.gain.raw:
        return f"kinematics find it of another size, or less of it than of {_name(winner)}"
    if winner is not None:
        return f"gains {100.0 * (1.0 - trial.gain.raw / winner.gain.raw):.0f} % less than {_name(winner)}"
    enough = trial.gain.net > gain_asked(trial.effect, criteria)
    return "leaves unexplained what is missing" if enough else "gains too little to be named"


def _name(trial: Trial) -> str:
    return effect_name(trial.effect)


def minor(diagnosis: Diagnosis) -> str:
    """List of what is real but minor, or not confirmed."""
    items = "".join(f"<li>{escape(pretty(c.sentence))}</li>" for c in diagnosis.minor)
    return f"<ul>{items}</ul>" if items else "<p>Nothing.</p>"


def unseen(diagnosis: Diagnosis) -> str:
    """Smallest effect of every kind that these records would have shown."""
    effects = {c.name: c.attached.effect for r in diagnosis.rounds for c in r.candidates}
    by_kind: dict[str, list[str]] = {}
    for name, size in diagnosis.detectable.items():
        effect = effects.get(name)
        if effect is None or effect.members:
            continue  # a set of coefficients has no one size
        label = "".join(f"{part} " for part in (effect.variant, effect.target) if part)
        by_kind.setdefault(effect.kind, []).append(f"{label}{quantity(size, effect.unit)}")
    rows = [
        (escape(kind.replace("_", " ")), escape("; ".join(sorted(by_kind[kind])))) for kind in KINDS if kind in by_kind
    ]
    caption = "Smallest size that would have been found, at 5.6σ after the derivatives took their share"
    return table(("kind", "smallest detectable"), rows, caption)


def seconds(diagnosis: Diagnosis) -> str:
    """Wall time per stage."""
    total = sum(diagnosis.seconds.values())
    rows = [(escape(stage), f"{s:.1f}") for stage, s in diagnosis.seconds.items()]
    return table(("stage", "s"), [*rows, ("together", f"{total:.1f}")], "Wall time")


def made_with(facts: Mapping[str, Any]) -> str:
    """Versions, seed, commit and command."""
    versions = ", ".join(f"{name} {number}" for name, number in facts["versions"].items() if number)
    command = " ".join(facts["command"])
    rows = [
        ("versions", escape(f"{versions}, Python {facts['python']}")),
        ("platform", escape(facts["platform"])),
        ("commit", escape(str(facts["commit"] or "–"))),
        ("seed", str(facts["seed"])),
        ("command", f"<code>{escape(command)}</code>"),
    ]
    return table(("", ""), rows, "Made with")


def remarks(diagnosis: Diagnosis) -> str:
    """What the reader of the records remarked, record by record."""
    held = diagnosis.held_out_as_given
    records = [*diagnosis.refitted.fit.flight.records, *held.fit.flight.records]
    items = "".join(f"<li>{escape(r.name)}: {escape(note)}</li>" for r in records for note in r.notes)
    return f"<ul>{items}</ul>" if items else ""
