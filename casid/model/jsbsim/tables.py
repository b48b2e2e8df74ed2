"""The tables in the aerodynamics of a JSBSim file: read for `casid.model.inside`, and mended where they stand."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence

from casid.errors import InputError
from casid.model.inside import Entry, FileTable
from casid.model.jsbsim.functions import pages_of, table_grid
from casid.model.jsbsim.source import part
from casid.model.mending import with_numbers

_DATA = re.compile(r"<(tableData)\b[^>]*>(.*?)</tableData>", re.DOTALL)
_TABLE = re.compile(r"<(table|t)\b[^>]*>(.*?)</\1>", re.DOTALL)


def entries(root: ET.Element) -> Iterator[Entry | None]:
    """The tables of a file in their order. None for one that is not read, and for one of three dimensions whose pages
    have breakpoints of their own: what changes at these is no stretch of all of it."""
    nodes = [n for n in part(root, "aerodynamics").iter() if n.tag in ("table", "t")]
    for index, node in enumerate(nodes):
        try:
            names, grid = table_grid(node)
            alike = len(names) < 3 or len({page.breakpoints for page in pages_of(node)}) == 1
        except InputError:
            alike = False
        called = node.get("name") or f"table {index + 1}"
        yield Entry(name=called, over=tuple(names), grid=grid) if alike else None


def mark(index: int) -> str:
    """The property that is added to a table."""
    return f"casid/mark-{index}"


def marked(root: ET.Element) -> str:
    """The text of a file with an increment on each table of its aerodynamics, the properties `mark`."""
    text = ET.tostring(root, encoding="unicode")
    copy = ET.fromstring(text)
    for i, node in enumerate([n for n in part(copy, "aerodynamics").iter() if n.tag in ("table", "t")]):
        inner = ET.Element("table", node.attrib)
        inner.extend(list(node))
        node.clear()
        node.tag = "sum"
        ET.SubElement(node, "value").text = "0"
        node.insert(0, inner)
        ET.SubElement(node, "property").text = mark(i)
    return ET.tostring(copy, encoding="unicode")


def with_changed_table(text: str, blank: str, one: FileTable, term: str, value: float) -> str:
    """The text of a file with a stretch of a table changed: `value` of the coefficient at the breakpoints that it has.
    Layout stays, numbers of unchanged breakpoints too. `blank` is the text without what stands in comments."""
    begin = blank.index("<aerodynamics")
    region = list(_TABLE.finditer(blank, begin, blank.index("</aerodynamics>", begin)))[one.index]
    data = list(_DATA.finditer(blank, *region.span(2)))
    if not data:
        raise InputError(f"table '{one.table.name}' has no tableData")
    share = one.share(term)
    cells = [(span, share[place]) for span, place in _cells(data, len(one.shape))]
    return with_numbers(text, [(span, value / one.gain * float(by)) for span, by in cells if by])


def _cells(pages: Sequence[re.Match[str]], dimensions: int) -> Iterator[tuple[tuple[int, int], tuple[int, ...]]]:
    """(span, place in the grid) of every value of a table."""
    for page, data in enumerate(pages):
        start = data.start(2)
        if dimensions == 1:
            for k, token in enumerate(list(re.finditer(r"\S+", data[2]))[1::2]):
                yield (start + token.start(), start + token.end()), (k,)
            continue
        lines = [line for line in re.finditer(r"[^\n]+", data[2]) if line[0].strip()]
        for row, line in enumerate(lines[1:]):
            for column, token in enumerate(list(re.finditer(r"\S+", line[0]))[1:]):
                at = start + line.start()
                yield (at + token.start(), at + token.end()), (page, row, column)[3 - dimensions :]
