"""No sentence over 35 words in the pages and in the docstrings, private ones too.

The truth is the bound of CONTRIBUTING.md ("House rules"). Code, tables and headings are left out; code, a formula or a
link within a sentence is one word, and the shape of an array none.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import casid

REPO = Path(__file__).resolve().parent.parent
MOST_WORDS = 35
PAGES = [REPO / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")] + sorted(
    (REPO / "docs").glob("*.md")
)
_LEFT_OUT = re.compile(r"(#|\||>>>|\.\. |:\w+:|<|---|===)")  # headings, tables, prompts, directives, markup
_ITEM = re.compile(r"([-*]|\d+\.)\s+")
_ROW = re.compile(r"\S+(, \S+| \S+)*\s{2,}\S")  # of a table by columns: names, then what they are
_SHAPE = re.compile(r"\((?:[\w+*^/-]{1,7},\s*)+(?:[\w+*^/-]{1,7})?\)")  # (N, R, n): part of what it is the shape of
_ONE_WORD = re.compile(r"``.+?``|`[^`]+`|\$\$.+?\$\$|\$[^$]+\$", re.DOTALL)
_LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
_END = re.compile(r"(?<=[.!?])[)\"'*]*\s+")


def blocks_of(text: str) -> Iterator[str]:
    """Paragraphs and items of lists: what a blank line, another indentation, an item or a fence parts."""
    block: list[str] = []
    fenced, hang = False, -1
    for line in [*text.splitlines(), ""]:
        bare = line.strip()
        indent = len(line) - len(line.lstrip())
        fence = bare.startswith(("```", ":::"))
        item = _ITEM.match(bare)
        row = _ROW.match(bare)
        if fence or fenced or not bare or item or row or indent != hang or _LEFT_OUT.match(bare):
            if block:
                yield " ".join(block)
            block = []
        fenced = fenced != fence
        if not bare or fence or fenced or _LEFT_OUT.match(bare):
            hang = -1
            continue
        hang = indent + (item.end() if item else row.end() - 1 if row else 0)
        block.append(bare[item.end() :] if item else bare)


def sentences(text: str) -> Iterator[tuple[int, str]]:
    """(number of words, sentence) of a text in Markdown or reStructuredText."""
    for block in blocks_of(text):
        plain = _SHAPE.sub("", _ONE_WORD.sub("code", _LINK.sub(r"\1", block)))
        for sentence in _END.split(plain):
            yield sum(any(letter.isalnum() for letter in word) for word in sentence.split()), sentence


def too_long(text: str) -> list[str]:
    return [f"{words} words: {sentence}" for words, sentence in sentences(text) if words > MOST_WORDS]


def docstrings() -> Iterator[tuple[str, str]]:
    """(file and line, docstring) of every module, class and function of casid."""
    for path in sorted((REPO / "casid").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                where = f"{path.relative_to(REPO)}:{getattr(node, 'lineno', 1)}"
                yield where, ast.get_docstring(node) or ""


def test_sentences_are_counted() -> None:
    text = """One two three. Four
five `six six six`!

```
no word of this
```
| nor | this |
- an item
  goes on: [seven eight](https://here) end

1. another $a + b$

name : type
    What it is.

gain, cost  (N, 3, k) of each
            sample
length      in all
"""
    assert [words for words, _ in sentences(text)] == [3, 3, 7, 2, 2, 3, 5, 3]


def test_a_long_sentence_is_found() -> None:
    assert not too_long("word " * 35 + ". word")
    assert too_long("Short. " + "word " * 36 + ".")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPO)))
def test_no_long_sentence_in_the_pages(page: Path) -> None:
    assert not too_long(page.read_text(encoding="utf-8"))


def test_no_long_sentence_in_docstrings() -> None:
    found = [f"{where}: {what}" for where, text in docstrings() for what in too_long(text)]
    assert not found, "\n".join(found)


def test_the_page_of_the_api_has_every_public_name() -> None:
    listed = set((REPO / "docs" / "api.md").read_text(encoding="utf-8").split())
    assert not set(casid.__all__) - {"__version__"} - listed
