"""Files of others with what flight has shown: which table an effect is wrong in, numbers changed where they stand."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from casid.model.causes.tables import holds
from casid.model.effect_value import EffectValue
from casid.model.inside import FileTable

_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)


def blanked(text: str) -> str:
    """XML of the same length without what stands in comments: positions in it are positions in the text."""
    return _COMMENT.sub(lambda found: " " * len(found.group()), text)


def with_numbers(text: str, changes: Iterable[tuple[tuple[int, int], float]]) -> str:
    """The text with numbers grown, each at its (first, last) position; layout stays as far as there is room."""
    for (first, last), by in sorted(changes, reverse=True):
        number = float(text[first:last]) + by
        text = text[:first] + f"{number:.10g}".ljust(last - first) + text[last:]
    return text


def holding(tables: Sequence[FileTable], effect: EffectValue) -> FileTable | None:
    """The table of the file of which an effect is a wrong stretch."""
    kind, coefficient, term = effect.kind, effect.target, effect.term or "0"
    return next((one for one in tables if holds(one.table, kind, coefficient, term)), None)


def said(effect: EffectValue, why: str) -> str:
    """An effect that a file cannot have, for a comment in it."""
    target = f"({effect.target}{':' + effect.term if effect.term else ''})" if effect.target else ""
    return f"{effect.kind}{target} {effect.value:.6g} {effect.unit}: it {why}"


def comment(left: Sequence[str]) -> str:
    """What a file cannot say, as a comment of it."""
    lines = "".join(f"\n       {line.replace('--', '- -')}" for line in left)
    return f"    <!-- casid found what stands in no function of this file:{lines}\n    -->\n"
