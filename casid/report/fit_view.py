"""A fit as a figure, a data frame, a LaTeX table and in a notebook."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from casid.errors import unknown
from casid.estimation.fit import Fit
from casid.frequency.output_error import FourierOutputError
from casid.frequency.regression import FourierEquationError
from casid.report.estimate_figures import histories
from casid.report.notebook import data_frame, html_list, html_paragraph, html_table
from casid.report.style import window

if TYPE_CHECKING:
    from pandas import DataFrame

_COLUMNS = ("value", "std", "std_cramer_rao", "prior", "prior_std")
_HEADS = ("value", "std", "Cramer-Rao", "a priori", "a-priori std")
_LATEX = str.maketrans({c: "\\" + c for c in "_%#&$"} | {"^": r"\textasciicircum{}", "~": r"\textasciitilde{}"})


def plot(fit: Fit, record: str | None) -> Figure:
    """Measured and predicted channels of one record, or their amplitudes over frequency where they are transforms."""
    records = {r.name: r for r in fit.problem.records}
    name = next(iter(records)) if record is None else record
    if name not in records:
        raise unknown("record", str(name), records, "fit.plot")
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


def frame(fit: Fit) -> DataFrame:
    """A row for each parameter."""
    return data_frame({n: {c: getattr(e, c) for c in _COLUMNS} for n, e in fit.parameters.items()}, "parameter")


def latex(fit: Fit) -> str:
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


def html(fit: Fit) -> str:
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
