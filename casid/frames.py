"""Results as data frames, LaTeX, HTML and in few lines."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from html import escape
from typing import TYPE_CHECKING, Any

from casid.errors import InputError

if TYPE_CHECKING:
    from pandas import DataFrame

_LATEX = str.maketrans({c: "\\" + c for c in "_%#&$"} | {"^": r"\textasciicircum{}", "~": r"\textasciitilde{}"})


def data_frame(rows: Mapping[str, Mapping[str, object]], index: str) -> DataFrame:
    """A pandas data frame of rows by name. Raises InputError where pandas is not installed."""
    try:
        import pandas
    except ImportError:
        raise InputError("to_frame needs pandas; install it with: pip install 'casid[pandas]'") from None
    table = pandas.DataFrame.from_dict({name: dict(row) for name, row in rows.items()}, orient="index")
    table.index.name = index
    return table


def latex_table(heads: Sequence[str], rows: Mapping[str, Sequence[float]]) -> str:
    """A tabular of numbers by name, with rules of booktabs."""
    lines = [r"\begin{tabular}{l" + "r" * (len(heads) - 1) + "}", r"\toprule"]
    lines += [" & ".join(heads) + r" \\", r"\midrule"]
    lines += [" & ".join((name.translate(_LATEX), *map(_number, row))) + r" \\" for name, row in rows.items()]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"])


def _number(value: float) -> str:
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


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of texts, the first column to the left, the others to the right; nothing for no rows."""
    left = "text-align:left"
    right = "text-align:right"
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(
        f"<tr><th style='{left}'>{escape(first)}</th>"
        + "".join(f"<td style='{right}'>{escape(cell)}</td>" for cell in cells)
        + "</tr>"
        for first, *cells in rows
    )
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>" if body else ""


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
