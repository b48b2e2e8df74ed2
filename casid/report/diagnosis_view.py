"""A diagnosis as a data frame and in a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

from casid.diagnosis.cause import Cause
from casid.diagnosis.result import Diagnosis
from casid.report.notebook import data_frame, html_list, html_paragraph, html_table
from casid.report.words import pretty, with_std

if TYPE_CHECKING:
    from pandas import DataFrame


def frame(diagnosis: Diagnosis) -> DataFrame:
    """A row for each cause, named ones before minor ones."""
    rows = [(cause, False) for cause in diagnosis.causes] + [(cause, True) for cause in diagnosis.minor]
    table: dict[str, dict[str, object]] = {}
    for cause, minor in rows:
        table[_name(cause)] = {
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


def _name(cause: Cause) -> str:
    inside = ":".join(part for part in (cause.target, cause.term) if part)
    return f"{cause.kind}({inside})" if inside else cause.kind


def html(diagnosis: Diagnosis) -> str:
    """The opening of the report, and the causes."""
    rows = [
        [_name(c), with_std(c.value, c.std, c.unit), "minor" if c in diagnosis.minor else "", c.sentence]
        for c in (*diagnosis.causes, *diagnosis.minor)
    ]
    table = html_table(("cause", "size ± 1σ", "", "what it is"), rows) if rows else ""
    verdict = html_paragraph(f"{diagnosis.aircraft.name}: {diagnosis.verdict}", pretty(diagnosis.sentence))
    said = [one.sentence for one in (*diagnosis.data, *diagnosis.contradicted)]
    return verdict + html_list(said) + table
