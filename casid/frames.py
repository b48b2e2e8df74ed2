"""Results as data frames, LaTeX, HTML and in few lines."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from html import escape
from typing import TYPE_CHECKING, Any

from casid.errors import InputError

if TYPE_CHECKING:
    from pandas import DataFrame

_LATEX = str.maketrans({c: "\\" + c for c in "_%#&$"} | {"^": r"\textasciicircum{}", "~": r"\textasciitilde{}"})


@dataclass(frozen=True, kw_only=True)
class Rows:
    """One table of a result, for a terminal, a notebook, a paper and a data frame.

    `heads`: head of a column -> form of its numbers, as ".4g"; the first column names the row. `keys`: head -> name of
    the column in a data frame, where that is another one. `rows` has numbers and texts; None is an empty cell.
    """

    heads: Mapping[str, str]
    rows: Sequence[Sequence[object]]
    keys: Mapping[str, str] = field(default_factory=dict)

    def cells(self) -> list[list[str]]:
        """Return the rows as they are read."""
        forms = list(self.heads.values())
        return [[_cell(value, form) for value, form in zip(row, forms, strict=True)] for row in self.rows]

    def text(self) -> str:
        """Return aligned lines, numbers to the right."""
        lines = [list(self.heads), *self.cells()]
        widths = [max(len(line[k]) for line in lines) for k in range(len(self.heads))]
        sides = [">" if form else "<" for form in self.heads.values()]
        columns = list(zip(widths, sides, strict=True))
        aligned = (
            [f"{cell:{side}{width}}" for cell, (width, side) in zip(line, columns, strict=True)] for line in lines
        )
        return "\n".join("  ".join(line).rstrip() for line in aligned)

    def html(self) -> str:
        """Return a table, the first column and texts to the left; nothing for no rows."""
        sides = ["right" if form else "left" for form in self.heads.values()]
        columns = zip(self.heads, ["left", *sides[1:]], strict=True)
        top = "".join(f"<th style='text-align:{side}'>{escape(head)}</th>" for head, side in columns)
        body = "".join(
            f"<tr><th style='text-align:left'>{escape(first)}</th>"
            + "".join(
                f"<td style='text-align:{side}'>{escape(cell)}</td>"
                for cell, side in zip(cells, sides[1:], strict=True)
            )
            + "</tr>"
            for first, *cells in self.cells()
        )
        return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>" if body else ""

    def latex(self) -> str:
        """Return a tabular with rules of booktabs."""
        sides = "".join("r" if form else "l" for form in self.heads.values())
        lines = [rf"\begin{{tabular}}{{{sides}}}", r"\toprule"]
        lines += [" & ".join(head.translate(_LATEX) for head in self.heads) + r" \\", r"\midrule"]
        lines += [" & ".join(map(_in_latex, row)) + r" \\" for row in self.rows]
        return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"])

    def frame(self) -> DataFrame:
        """Return a pandas data frame. Raises InputError where pandas is not installed."""
        try:
            import pandas
        except ImportError:
            raise InputError("to_frame needs pandas; install it with: pip install 'casid[pandas]'") from None
        names = [self.keys.get(head, head) for head in self.heads]
        return pandas.DataFrame([list(row) for row in self.rows], columns=names).set_index(names[0])


def _cell(value: object, form: str) -> str:
    if value is None:
        return ""
    if not form or isinstance(value, str):
        return str(value)
    assert isinstance(value, float | int)
    return f"{value:{form}}" if math.isfinite(value) else "–"


def _in_latex(value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, float | int):
        return ("" if value is None else str(value)).translate(_LATEX)
    if not math.isfinite(value):
        return "--"
    digits, _, power = f"{value:.4g}".partition("e")
    return f"${digits}" + (rf" \cdot 10^{{{int(power)}}}" if power else "") + "$"


def html_paragraph(head: str, text: str) -> str:
    """A head line in bold, and a text below."""
    return f"<p><b>{escape(head)}</b><br>{escape(text)}</p>"


def html_list(items: Iterable[str]) -> str:
    """A list of sentences; nothing for none."""
    lines = "".join(f"<li>{escape(item)}</li>" for item in items)
    return f"<ul>{lines}</ul>" if lines else ""


def brief(self: Any) -> str:
    """The `repr` of a dataclass with arrays and tables in it, in a few lines: what it has, not all its numbers."""
    inside = (f"{f.name}={_short(getattr(self, f.name))}" for f in fields(self) if not f.name.startswith("_"))
    return f"{type(self).__name__}({', '.join(inside)})"


def _short(value: Any) -> str:
    if getattr(value, "shape", ()) != ():
        return f"<{type(value).__name__} {'x'.join(map(str, value.shape))}>"
    if isinstance(value, Mapping) and len(value) > 3:
        return f"<{len(value)} by name: {', '.join(map(str, list(value)[:3]))}, ...>"
    if isinstance(value, (tuple, list)) and len(value) > 3:
        return f"<{len(value)} of {type(value[0]).__name__}>"
    text = repr(value)
    return text if len(text) <= 120 and "\n" not in text else f"<{type(value).__name__}>"
