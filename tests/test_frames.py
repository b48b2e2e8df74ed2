"""One table of a result in four forms. Truth: its own numbers, read back from each form."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from casid.frames import Rows

_NUMBERS = st.floats(-1e6, 1e6, allow_nan=False).map(lambda x: float(f"{x:.4g}"))
_NAMES = st.text("abcXYZ_0123", min_size=1, max_size=12)
_TABLES = st.lists(st.tuples(_NAMES, _NUMBERS, _NAMES), min_size=1, max_size=6)


def table(rows: list) -> Rows:
    return Rows(heads={"name": "", "size": ".4g", "note": ""}, rows=rows, keys={"size": "value"})


@given(rows=_TABLES)
def test_text_html_and_latex_have_the_same_cells(rows: list) -> None:
    found = table(rows)
    text = [line.split() for line in found.text().splitlines()]
    cells = re.findall(r"<t[hd] style='text-align:\w+'>(.*?)</t[hd]>", found.html())
    assert text[0] == ["name", "size", "note"]
    assert [float(line[1]) for line in text[1:]] == [size for _, size, _ in rows]
    assert cells == [cell for line in text for cell in line]
    lines = [line.removesuffix(r" \\").split(" & ") for line in found.latex().splitlines()[4:-2]]
    assert [line[0].replace("\\_", "_") for line in lines] == [name for name, _, _ in rows]
    numbers = [re.sub(r" \\cdot 10\^\{(.*)\}", r"e\1", line[1].strip("$")) for line in lines]
    assert [float(one) for one in numbers] == [size for _, size, _ in rows]


@given(rows=_TABLES)
def test_columns_of_text_stand_below_each_other(rows: list) -> None:
    """Numbers end where their head ends, texts begin where theirs begins."""
    head, *lines = table(rows).text().splitlines()
    end, begin = head.index("size") + len("size"), head.index("note")
    for line, (_, size, note) in zip(lines, rows, strict=True):
        assert line[:end].endswith(f"{size:.4g}") and line[begin:] == note


def test_a_frame_has_the_values_and_what_is_missing_has_a_sign() -> None:
    pytest.importorskip("pandas")
    found = table([("a", math.nan, "x"), ("b", None, "y"), ("c", 2.0, "z")])
    frame = found.frame()
    assert frame.index.name == "name" and list(frame.columns) == ["value", "note"]
    assert frame.loc["c", "value"] == 2.0
    assert [cells[1] for cells in found.cells()] == ["–", "", "2"]
