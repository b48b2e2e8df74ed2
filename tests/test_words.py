"""No sentence over 35 words in the pages and in the docstrings of public names.

The truth is the bound of CONTRIBUTING.md ("House rules"). Code, tables and headings are left out; code, a formula or a
link within a sentence is one word.
"""

from __future__ import annotations

import inspect
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
        if fence or fenced or not bare or item or indent != hang or _LEFT_OUT.match(bare):
            if block:
                yield " ".join(block)
            block = []
        fenced = fenced != fence
        if not bare or fence or fenced or _LEFT_OUT.match(bare):
            hang = -1
            continue
        hang = indent + item.end() if item else indent
        block.append(bare[item.end() :] if item else bare)


def sentences(text: str) -> Iterator[tuple[int, str]]:
    """(number of words, sentence) of a text in Markdown or reStructuredText."""
    for block in blocks_of(text):
        plain = _ONE_WORD.sub("code", _LINK.sub(r"\1", block))
        for sentence in _END.split(plain):
            yield sum(any(letter.isalnum() for letter in word) for word in sentence.split()), sentence


def too_long(text: str) -> list[str]:
    return [f"{words} words: {sentence}" for words, sentence in sentences(text) if words > MOST_WORDS]


def public_docstrings() -> Iterator[tuple[str, str]]:
    """(name, docstring) of every public name and of its public methods and properties."""
    for name in casid.__all__:
        thing = getattr(casid, name)
        yield name, inspect.getdoc(thing) or ""
        if inspect.isclass(thing):
            for method, member in vars(thing).items():
                if not method.startswith("_") and (callable(member) or isinstance(member, (property, classmethod))):
                    yield f"{name}.{method}", inspect.getdoc(member) or ""


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
"""
    assert [words for words, _ in sentences(text)] == [3, 3, 7, 2, 2, 3]


def test_a_long_sentence_is_found() -> None:
    assert not too_long("word " * 35 + ". word")
    assert too_long("Short. " + "word " * 36 + ".")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPO)))
def test_no_long_sentence_in_the_pages(page: Path) -> None:
    assert not too_long(page.read_text(encoding="utf-8"))


def test_no_long_sentence_in_public_docstrings() -> None:
    found = [f"{name}: {what}" for name, text in public_docstrings() for what in too_long(text)]
    assert not found, "\n".join(found)


def test_the_page_of_the_api_has_every_public_name() -> None:
    listed = set((REPO / "docs" / "api.md").read_text(encoding="utf-8").split())
    assert not set(casid.__all__) - {"__version__"} - listed
