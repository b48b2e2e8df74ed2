"""A DAVE-ML file with what flight has shown: numbers of its tables, and a comment of what no table can have."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from casid.errors import InputError
from casid.model.daveml.functions import dave_file
from casid.model.effect_value import EffectValue
from casid.model.inside import FileTable
from casid.model.mending import blanked, comment, holding, said, with_numbers

_FUNCTION = re.compile(r"<((?:\w+:)?function)\b[^>]*>(.*?)</\1\s*>", re.DOTALL)
_REFERENCE = re.compile(r"<(?:\w+:)?griddedTableRef\b[^>]*\bgtID\s*=\s*[\"']([^\"']*)[\"']")
_DATA = re.compile(r"<((?:\w+:)?dataTable)\b[^>]*>(.*?)</\1\s*>", re.DOTALL)
_END = re.compile(r"</(?:\w+:)?DAVEfunc\s*>")


def mended_text(
    text: str, tables: Sequence[FileTable], effects: Sequence[EffectValue], terms: Mapping[str, Mapping[str, float]]
) -> str:
    """The text of a file with wrong stretches of its tables mended where they stand.

    effects  as an aircraft file has them
    terms    coefficient -> monomial -> value, increments of coefficients, which no table of the file can have
    """
    left: list[str] = []
    for effect in effects:
        held = None if effect.records or effect.onset_s else holding(tables, effect)
        if held is None:
            left.append(said(effect, "has no place in a table of a DAVE-ML file"))
        else:
            text = _with_changed_table(text, held, held.share(effect.term or "0") * (effect.value / held.gain))
    left += [f"{c}: {value:.6g} times {term}" for c, row in terms.items() for term, value in row.items() if value]
    if left:
        end = list(_END.finditer(blanked(text)))[-1].start()
        text = text[:end] + comment(left) + text[end:]
    dave_file(text)
    return text


def _with_changed_table(text: str, one: FileTable, change: np.ndarray) -> str:
    varid = list(dave_file(text).functions())[one.index]
    blank = blanked(text)
    gives = re.compile(rf"<(?:\w+:)?dependentVarRef\b[^>]*\bvarID\s*=\s*[\"']{re.escape(varid)}[\"']")
    region = next(found for found in _FUNCTION.finditer(blank) if gives.search(found[2]))
    data = _DATA.search(blank, *region.span(2))
    if data is None and (reference := _REFERENCE.search(region[2])) is not None:
        named = re.compile(rf"<(?:\w+:)?griddedTableDef\b[^>]*\bgtID\s*=\s*[\"']{re.escape(reference[1])}[\"']")
        data = next((_DATA.search(blank, found.end()) for found in named.finditer(blank)), None)
    if data is None:
        raise InputError(f"table '{one.table.name}' has no dataTable")
    spans = [(data.start(2) + n.start(), data.start(2) + n.end()) for n in re.finditer(r"[^\s,]+", data[2])]
    return with_numbers(text, [(span, float(by)) for span, by in zip(spans, change.ravel(), strict=True) if by])
