"""The report of the diagnosis of any dynamic system: one self-contained HTML page, and its figures beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from casid.diagnosis.systems.result import ParameterValue, SystemCause, SystemDiagnosis
from casid.records.record import Record
from casid.report import tables
from casid.report.budget_figures import budget
from casid.report.estimate_figures import histories
from casid.report.style import Picture, settings
from casid.report.tables import Share
from casid.report.templating import COLOURS, FIGURES, ReportTable, Row, drawn_into, figures_of, render
from casid.report.words import digits, probability_in_words, with_std

_MOST = 4  # explanations told one by one, and held-out records drawn
_LEAST = 0.005  # a probability, or a relative change, that is told
_STEPS = {"as given": "as_given", "re-estimated": "refitted", "extended": "extension"}


def write_system_report(diagnosis: SystemDiagnosis, folder: str | Path, made_with: Mapping[str, Any]) -> None:
    """Write `report.html` and `report_figures/*.svg` into `folder`, which is made."""
    with settings():
        shown = {one.name: one for one in (budget(diagnosis.budget), *_histories(diagnosis))}
    figures = figures_of(drawn_into(Path(folder) / FIGURES, shown), {})
    context = {
        "system": diagnosis.model.name,
        "colour": COLOURS[diagnosis.verdict],
        "found": diagnosis,
        "shares": _shares(diagnosis),
        "gained": _gained(diagnosis),
        "figures": list(figures.values()),
        "tables": {
            "causes": _causes(diagnosis),
            "parameters": _parameters(diagnosis),
            "channels": _channels(diagnosis),
            "unknown": _unknown(diagnosis),
            "made_with": tables.made_with(made_with),
        },
    }
    (Path(folder) / "report.html").write_text(render("system.html", context), encoding="utf-8")


def _histories(diagnosis: SystemDiagnosis) -> Iterator[Picture]:
    """Measured and simulated on the held-out records, with the inputs on the same axis of time."""
    for record in diagnosis.held_out[:_MOST]:
        outputs = [name for name in diagnosis.model.outputs if name in record]
        inputs = [name for name in diagnosis.model.inputs if name in record]
        curves = {
            label: _beside(record, getattr(diagnosis, step).simulated.get(record.name, {}), outputs, len(inputs))
            for label, step in _STEPS.items()
        }
        channels = [*outputs, *inputs]
        picture = histories(record.name, record.t, channels, record.matrix(channels), curves)
        yield replace(
            picture,
            title=f"{record.name}, which no fit has seen: measured and simulated",
            caption="Measured outputs, the model as given, with its parameters re-estimated, and "
            f"extended by the named causes; below the inputs: {', '.join(inputs) or 'none'}. "
            "A model that diverges is not drawn.",
        )


def _beside(record: Record, simulated: Mapping[str, np.ndarray], outputs: list[str], inputs: int) -> np.ndarray:
    """(N, outputs + inputs) as simulated; nothing of inputs, nor of what diverged."""
    nothing = np.full(len(record), np.nan)
    return np.stack([*(simulated.get(name, nothing) for name in outputs), *[nothing] * inputs], axis=1)


def _shares(diagnosis: SystemDiagnosis) -> list[Share]:
    told = [
        Share(what=" and ".join(sorted(map(_title, names))) or "nothing is missing", probability=p)
        for names, p in list(diagnosis.explanations.items())[:_MOST]
        if p >= _LEAST
    ]
    rest = 1.0 - sum(one.probability for one in told)
    return [*told, Share(what="other explanations", probability=rest)] if rest >= _LEAST else told


def _title(name: str) -> str:
    """Of a cause from its name in tables: "sensor_bias(out)" -> "out: sensor bias"."""
    kind, _, inside = name.rstrip(")").partition("(")
    target, _, term = inside.partition(":")
    return f"{target}: {kind.replace('_', ' ')}{f' {term}' if term else ''}"


def _gained(diagnosis: SystemDiagnosis) -> dict[str, str]:
    """What the extended model makes better and worse on the held-out records."""
    before, after, steps = diagnosis.as_given.rms, diagnosis.extension.rms, diagnosis.budget.together
    change = {name: after[name] / rms - 1.0 for name, rms in before.items() if rms > 0.0 and np.isfinite(rms)}

    def told(sign: float) -> str:
        return ", ".join(
            f"{name} {100.0 * part:+.0f} %".replace("-", "−")
            for name, part in sorted(change.items(), key=lambda item: -abs(item[1]))
            if sign * part > _LEAST
        )

    return {
        "together": f"On {', '.join(diagnosis.budget.records)}, which no fit has seen, the simulation is off by "
        f"{_times(steps.as_given)} the noise as given, by {_times(steps.values)} re-estimated, and by "
        f"{_times(steps.structure)} extended.",
        "worse": told(1.0),
        "better": told(-1.0),
    }


def _times(ratio: float) -> str:
    return f"{digits(ratio, 2)} times" if np.isfinite(ratio) else "more than any multiple of"


def _causes(diagnosis: SystemDiagnosis) -> ReportTable:
    head = (
        "cause",
        "size ± 1σ",
        "records",
        "probability",
        "log likelihood gain per reading, held out",
        "cannot be told apart from",
    )
    rows = tuple(_cause(one, minor) for some, minor in _named(diagnosis) for one in some)
    return ReportTable(head=head, rows=rows, caption="Causes, strongest first; minor causes last")


def _named(diagnosis: SystemDiagnosis) -> tuple[tuple[tuple[SystemCause, ...], bool], ...]:
    return (diagnosis.causes, False), (diagnosis.minor, True)


def _cause(one: SystemCause, minor: bool) -> Row:
    inside = f"{one.target}:{one.term}" if one.term else one.target
    gain = one.held_out_gain
    cells = (
        _title(f"{one.kind}({inside})") + (" (minor)" if minor else ""),
        with_std(one.value, one.std, one.unit),
        _where(one),
        probability_in_words(one.probability),
        "–" if gain is None else f"{gain:+.3f}".replace("-", "−"),
        ", ".join(f"{_title(name)} ({probability_in_words(p)})" for name, p in one.indistinguishable_from) or "–",
    )
    return Row(cells=cells)


def _where(one: SystemCause) -> str:
    if one.onset_s:
        return ", ".join(f"{record} from {t:.1f} s" for record, t in one.onset_s.items())
    return ", ".join(one.records) or "all"


def _parameters(diagnosis: SystemDiagnosis) -> ReportTable:
    return ReportTable(
        head=("parameter", "in the model", "its stated 1σ", "re-estimated ± 1σ", "extended ± 1σ", ""),
        rows=tuple(_parameter(one) for one in diagnosis.parameters),
        caption="Parameters of the model. 1σ by Cramer-Rao. Against the records: beyond the stated uncertainty, "
        "or a tenth where none is, and beyond 3σ.",
        numeric=True,
    )


def _parameter(one: ParameterValue) -> Row:
    cells = (
        f"{one.name} [{one.unit}]" if one.unit else one.name,
        digits(one.nominal, 4),
        digits(one.prior_std, 2) if np.isfinite(one.prior_std) else "not stated",
        with_std(one.refitted, one.refitted_std, ""),
        with_std(one.extended, one.extended_std, ""),
        "against the records" if one.contradicted else "",
    )
    return Row(cells=cells, marked=one.contradicted)


def _channels(diagnosis: SystemDiagnosis) -> ReportTable:
    rows = tuple(
        Row(
            cells=(
                name,
                digits(sigma, 2),
                *(digits(getattr(diagnosis, step).rms.get(name, np.nan)) for step in _STEPS.values()),
            )
        )
        for name, sigma in diagnosis.noise.items()
    )
    return ReportTable(
        head=("output", "noise 1σ", *_STEPS),
        rows=rows,
        caption=f"r.m.s. error over the noise, open-loop simulation of {', '.join(diagnosis.budget.records)}",
        numeric=True,
    )


def _unknown(diagnosis: SystemDiagnosis) -> ReportTable:
    rows = tuple(Row(cells=(one.port.words, probability_in_words(one.probability))) for one in diagnosis.unexplained)
    return ReportTable(head=("where", "probability"), rows=rows, caption="Where something unknown enters")
