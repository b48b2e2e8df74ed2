"""Fits and diagnoses in a notebook: data frames, LaTeX tables, HTML."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from casid.diagnosis.result import Diagnosis
from casid.errors import InputError, check_known
from casid.estimation.fit import Fit
from casid.frequency.output_error import FourierOutputError
from casid.frequency.regression import FourierEquationError
from casid.report.estimate_figures import histories
from casid.report.style import window
from casid.report.words import pretty, with_std

if TYPE_CHECKING:
    from pandas import DataFrame


def data_frame(rows: Mapping[str, Mapping[str, object]], index: str) -> DataFrame:
    """A pandas data frame of rows by name. Raises InputError where pandas is not installed."""
    try:
        import pandas
    except ImportError:
        raise InputError("to_frame needs pandas; install it with: pip install 'casid[pandas]'") from None
    table = pandas.DataFrame.from_dict({name: dict(row) for name, row in rows.items()}, orient="index")
    table.index.name = index
    return table


def html_paragraph(head: str, text: str) -> str:
    """A head line in bold, and a text below."""
    return f"<p><b>{escape(head)}</b><br>{escape(text)}</p>"


def html_list(items: Iterable[str]) -> str:
    """A list of sentences; nothing for none."""
    lines = "".join(f"<li>{escape(item)}</li>" for item in items)
    return f"<ul>{lines}</ul>" if lines else ""


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of texts, the first column to the left, the others to the right."""
    left, right = "text-align:left", "text-align:right"
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(
        f"<tr><th style='{left}'>{escape(first)}</th>"
        + "".join(f"<td style='{right}'>{escape(cell)}</td>" for cell in cells)
        + "</tr>"
        for first, *cells in rows
    )
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


_COLUMNS = ("value", "std", "std_cramer_rao", "prior", "prior_std")
_HEADS = ("value", "std", "Cramer-Rao", "a priori", "a-priori std")
_LATEX = str.maketrans({c: "\\" + c for c in "_%#&$"} | {"^": r"\textasciicircum{}", "~": r"\textasciitilde{}"})


def plot_fit(fit: Fit, record: str | None) -> Figure:
    """Measured and predicted channels of one record, or their amplitudes over frequency where they are transforms."""
    records = {r.name: r for r in fit.problem.records}
    name = next(iter(records)) if record is None else record
    check_known("record", (name,), records, "fit.plot")
    predicted = fit.predictions[name]
    measured = predicted + fit.residuals[name]
    if isinstance(cost := fit.problem.cost, FourierEquationError | FourierOutputError):
        frequencies = cost.equations(fit.problem).frequencies[list(records).index(name)]
        omega = np.unique(frequencies)
        which = frequencies == omega[:, None]
        values = (measured, predicted, fit.residuals[name])
        measured, predicted, rest = (np.sqrt(which @ np.nan_to_num(one) ** 2) for one in values)
        curves = {"fitted": predicted, "difference": rest}
        return histories(name, omega, list(fit.channels), measured, curves, window, axis="frequency ω [rad/s]").figure
    return histories(name, records[name].t, list(fit.channels), measured, {"fitted": predicted}, window).figure


def fit_frame(fit: Fit) -> DataFrame:
    """A row for each parameter."""
    return data_frame({n: {c: getattr(e, c) for c in _COLUMNS} for n, e in fit.parameters.items()}, "parameter")


def fit_latex(fit: Fit) -> str:
    """A tabular with rules of booktabs."""
    lines = [r"\begin{tabular}{l" + "r" * len(_COLUMNS) + "}", r"\toprule"]
    lines += [" & ".join(("parameter", *_HEADS)) + r" \\", r"\midrule"]
    for name, e in fit.parameters.items():
        cells = (_number(getattr(e, column)) for column in _COLUMNS)
        lines.append(" & ".join((name.translate(_LATEX), *cells)) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"])


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "--"
    digits, _, power = f"{value:.4g}".partition("e")
    return f"${digits}" + (rf" \cdot 10^{{{int(power)}}}" if power else "") + "$"


def fit_html(fit: Fit) -> str:
    """Status, remarks, and the tables of parameters and channels."""
    head = f"{fit.problem.model.name}: {type(fit.problem.cost).__name__}, {fit.method}, {fit.solver}"
    parameters = [
        [name, *(f"{getattr(e, c):.5g}" if math.isfinite(getattr(e, c)) else "" for c in _COLUMNS)]
        for name, e in fit.parameters.items()
    ]
    channels = [
        [name, f"{c.rms:.4g}", f"{c.R2:.4f}", f"{c.theil:.3f}", str(c.samples)] for name, c in fit.channels.items()
    ]
    return (
        html_paragraph(head, f"{fit.status}; {fit.iterations} iterations, ln(likelihood) {fit.log_likelihood:.8g}")
        + html_list(fit.remarks)
        + html_table(("parameter", *_HEADS), parameters)
        + html_table(("channel", "rms", "R2", "Theil", "samples"), channels)
    )


def diagnosis_frame(diagnosis: Diagnosis) -> DataFrame:
    """A row for each cause, named ones before minor ones."""
    rows = [(cause, False) for cause in diagnosis.causes] + [(cause, True) for cause in diagnosis.minor]
    table: dict[str, dict[str, object]] = {}
    for cause, minor in rows:
        table[cause.name] = {
            "kind": cause.kind,
            "target": cause.target,
            "term": cause.term,
            "value": cause.value,
            "std": cause.std,
            "unit": cause.unit,
            "records": ", ".join(cause.records),
            "minor": minor,
            "held_out_gain": cause.held_out_gain,
            "sentence": cause.sentence,
        }
    return data_frame(table, "cause")


def diagnosis_html(diagnosis: Diagnosis) -> str:
    """The opening of the report, and the causes."""
    rows = [
        [c.name, with_std(c.value, c.std, c.unit), "minor" if c in diagnosis.minor else "", c.sentence]
        for c in (*diagnosis.causes, *diagnosis.minor)
    ]
    table = html_table(("cause", "size ± 1σ", "", "what it is"), rows) if rows else ""
    verdict = html_paragraph(f"{diagnosis.part.name}: {diagnosis.verdict}", pretty(diagnosis.sentence))
    said = [one.sentence for one in (*diagnosis.data, *diagnosis.contradicted)]
    return verdict + html_list(said) + table
