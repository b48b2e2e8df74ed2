"""The page that sets our Table 5 beside the paper's, cell by cell, and answers the paper's claims."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from problems.paper.pages.page import Section, paragraph, table, write_page
from problems.paper.published import Cells, Claim, Part, claims

_ESTIMATORS = ("equation", "output", "combined")

DEPARTURE = (
    "A run has departed when the motion that the estimator ended with, or the flight of the model with the estimate "
    "from the true start by the exact stick (with the control law where the aircraft has one), does not stay finite "
    "and inside |alpha|, |beta| < 0.5 rad, |p| < 3 rad/s, |q|, |r| < 1.5 rad/s. It is judged so for every estimator, "
    "method and case; departed runs take no part in the means. Runs that did not converge are counted apart and do "
    "take part. With nonlinear truth a linear model cannot fit; a departure then means that the estimator lost the "
    "motion or that its estimate cannot be flown through the manoeuvre it came from."
)


def write_table_page(
    path: str | Path,
    rows: Sequence[Mapping[str, Any]],
    published: Cells,
    answers: Mapping[str, Sequence[Claim]],
    words: Mapping[str, str],
    timing: str,
    made_with: Mapping[str, Any],
) -> None:
    """Write the page. rows: case, estimator, method, statistic, value; answers: method -> claims counted in our table,
    to stand beside those of the `published` one; words: method -> what it is."""
    sections = [
        Section(title="The paper's four claims", parts=[_claims(answers, claims(published))]),
        Section(
            title="Departures",
            parts=[
                paragraph(DEPARTURE),
                _counts(rows, published, "departures_of_"),
                _counts(rows, published, "not_converged_of_"),
            ],
        ),
        *(Section(title=f"Table 5, {name}", parts=_beside(rows, published, name)) for name in words),
    ]
    lead = [
        "Three estimators on simulated flights of the Do 328-100, after Oezger, AIAA 2010-34. Errors are relative "
        "r.m.s. errors of each derivative's contribution (eq. 17), matches are mean absolute differences from "
        "noise-free truth.",
        "Manoeuvres, sizes of the nonlinear terms and the meaning of noise amplitude (three standard deviations) are "
        "ours, since the paper gives none: compare orders and rankings, not digits.",
        *(f"{name}: {text}." for name, text in words.items()),
        timing,
    ]
    write_page(path, "Table 5 of the paper, and ours", lead, sections, made_with)


def _claims(answers: Mapping[str, Sequence[Claim]], printed: Sequence[Claim]) -> str:
    rows = []
    for i, claim in enumerate(printed):
        rows.append([f"{claim.number}. {claim.words}", *(own[i].answer for own in answers.values()), claim.answer])
        for j, part in enumerate(claim.parts):
            own = [_counted(c[i].parts[j]) for c in answers.values()]
            rows.append([f"– {part.words}", *own, _counted(part)])
    caption = "cells of the table that bear the claim out; confirmed from 90 %, refuted below 50 %, else it depends"
    return table(["claim", *answers, "the paper's own table"], rows, caption)


def _counted(part: Part) -> str:
    if not part.cells:
        return "–"
    worst = f", up to {part.largest:.0e}" if part.largest is not None else ""
    return f"{part.holds} of {part.cells}{worst}"


def _counts(rows: Sequence[Mapping[str, Any]], published: Cells, prefix: str) -> str:
    found: dict[tuple[str, str], dict[str, int]] = {}
    total: dict[str, str] = {}
    for row in rows:
        if row["statistic"].startswith(prefix):
            found.setdefault((row["case"], row["method"]), {})[row["estimator"]] = int(row["value"])
            total[row["case"]] = row["statistic"].removeprefix(prefix)
    printed = {(c, e): v for (c, e, s), v in published.items() if s.startswith(prefix)}
    lines = []
    for (case, method), counts in found.items():
        paper = [printed.get((case, e)) for e in _ESTIMATORS]
        told = "/".join(f"{v:.0f}" for v in paper if v is not None) or "–"
        lines.append([case, method, f"of {total[case]}", *(counts[e] for e in _ESTIMATORS), told])
    name = prefix.removesuffix("_of_").replace("_", " ")
    return table(["case", "method", "runs", *_ESTIMATORS, "paper"], lines, name)


def _beside(rows: Sequence[Mapping[str, Any]], published: Cells, method: str) -> list[str]:
    """One table per case: statistic, then ours, the paper's and the ratio for each estimator."""
    cells = {(r["case"], r["estimator"], r["statistic"]): r["value"] for r in rows if r["method"] == method}
    head = ["statistic", *(f"{e}: {what}" for e in _ESTIMATORS for what in ("ours", "paper", "ratio"))]
    parts = []
    for case in dict.fromkeys(key[0] for key in cells):
        names = dict.fromkeys(key[2] for key in cells if key[0] == case)
        lines = []
        for name in names:
            line: list[Any] = [name]
            for estimator in _ESTIMATORS:
                ours, theirs = cells.get((case, estimator, name)), published.get((case, estimator, name))
                line += [ours, theirs, ours / theirs if ours is not None and theirs else None]
            lines.append(line)
        parts.append(table(head, lines, f"case {case}"))
    return parts
