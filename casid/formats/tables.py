"""An aircraft as a table of numbers: CSV for programs, LaTeX for reports."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator

from casid.errors import InputError
from casid.formats.matlab import struct_of
from casid.model.aircraft import Aircraft
from casid.model.effects import effect_of
from casid.model.terms import derivative_term, parse_term

HEAD = ("section", "name", "value", "std", "unit")
_UNITS = {"mass": "kg", "gravity": "m/s2", "area": "m2"}
_TRIM_UNITS = {"V": "m/s", "altitude": "m", "rho": "kg/m3", "thrust": "N", "gravity": "m/s2"}
_LATEX = str.maketrans(
    {c: "\\" + c for c in "_%#&${}"}
    | {"^": r"\textasciicircum{}", "~": r"\textasciitilde{}", "\\": r"\textbackslash{}"}
)

Row = tuple[str, str, float, float, str]


def rows_of(aircraft: Aircraft) -> Iterator[Row]:
    """(section, name, value, 1-sigma or NaN, unit) of every number. Raises InputError for tables and own aerodynamics,
    which are no list of numbers."""
    if aircraft.tables:
        raise InputError(f"'{aircraft.name}': a list of numbers cannot hold its tables; export to matlab")
    struct = struct_of(aircraft)
    for name, value in struct.items():
        if isinstance(value, float):
            yield "aircraft", name, value, math.nan, _UNITS.get(name, "m")
    for name, value in struct["inertia"].items():
        yield "inertia", name, value, math.nan, "kg m2"
    for name, value in aircraft.trim.items():
        yield "trim", name, value, math.nan, _TRIM_UNITS.get(name, "rad")
    share = aircraft.relative_uncertainty or math.nan
    for name, value in aircraft.derivatives.items():
        yield "derivatives", name, value, aircraft.std.get(name, share * abs(value)), derivative_term(name)[1].unit
    for coefficient, row in aircraft.terms.items():
        for term, value in row.items():
            std = aircraft.std.get(f"{coefficient}_{term}", share * abs(value))
            yield f"terms {coefficient}", term, value, std, parse_term(term).unit
    for one in aircraft.effects:
        effect = effect_of(one)
        yield "effects", effect.name, one.value, one.std or math.nan, one.unit
        for key, value in one.parameters.items():
            yield "effects", f"{effect.name}.{key}", value, math.nan, effect.units.get(key, "")


def csv_text(aircraft: Aircraft) -> str:
    """One row for each number, to full precision; `force_axes` in the first row under the head."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(HEAD)
    writer.writerow(("aircraft", "name", _cell(aircraft.name), "", ""))
    writer.writerow(("aircraft", "force_axes", aircraft.force_axes, "", ""))
    for section, name, value, std, unit in rows_of(aircraft):
        writer.writerow((_cell(section), _cell(name), repr(value), "" if math.isnan(std) else repr(std), unit))
    return out.getvalue()


def _cell(text: str) -> str:
    """Return a text as a cell that a spreadsheet does not take for a formula."""
    return f"'{text}" if text[:1] in ("=", "+", "-", "@") else text


def latex_text(aircraft: Aircraft) -> str:
    """A tabular with rules of booktabs, to six digits."""
    lines = [
        f"% {' '.join(aircraft.name.split())}, written by casid; needs \\usepackage{{booktabs}}",
        r"\begin{tabular}{llrrl}",
    ]
    lines += [r"\toprule", " & ".join(HEAD) + r" \\"]
    before = ""
    for section, name, value, std, unit in rows_of(aircraft):
        if section != before:
            lines.append(r"\midrule")
        shown = "" if section == before else section.translate(_LATEX)
        before = section
        spread = "" if math.isnan(std) else _number(std, 2)
        lines.append(
            " & ".join((shown, name.translate(_LATEX), _number(value, 6), spread, unit.translate(_LATEX))) + r" \\"
        )
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _number(value: float, digits: int) -> str:
    mantissa, _, power = f"{value:.{digits}g}".partition("e")
    return f"${mantissa}" + (rf" \cdot 10^{{{int(power)}}}" if power else "") + "$"
