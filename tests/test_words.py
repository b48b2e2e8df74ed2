"""The words of pages and docstrings: plain terms of the field, and every public name has an entry in the reference."""

from __future__ import annotations

import ast
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

import casid

REPO = Path(__file__).resolve().parent.parent
# Files whose docstrings and comments follow the same rules. Messages follow them in all files.
CODE = ("casid/diagnosis/**/*.py", "casid/data_check/*.py")
MESSAGES = sorted((REPO / "casid").rglob("*.py"))
PAGES = (REPO / "README.md", REPO / "CONTRIBUTING.md", *sorted((REPO / "docs").glob("*.md")))

# Words that only insiders understand -> what a page says instead. Terms are defined in docs/glossary.md.
REPLACEMENTS = {
    r"stands? against flight": "is inconsistent with flight",
    r"(the )?file refitted|refitted (file|model)": "re-estimated model",
    r"told by (them|these|the records)|tell little of": "identifiable from these records",
    r"what is told\b|\b(is|are) told\b(?! apart)": "what is reported",
    r"\bthat is said\b|\band is said\b": "this is reported",
    r"\bas wholes\b|\bwholes are\b": "complete hypotheses",
    r"\bsmall (further )?terms of\b": "model discrepancy",
    r"\b(unknown|anonymous|slow) (history|histories)\b|\banonymous\b": "latent input",
    r"\bdrops? of the deviance\b": "likelihood-ratio statistic",
    r"\bits price\b|\bthe price of its\b": "selection penalty",
    r"\bpromis(es?|ed|ing)\b": "predicted (score statistic)",
    r"\bhonest(ly)?\b": "corrected (standard deviation)",
    r"\bvalues refitted\b": "values re-estimated",
    r"\buntil (that|this|it) is\b": "only after this has been ...",
    r"\bfor what is no\b": "for arguments that are not ...",
    r"\bmakes more missing\b|\bwhat is no\b|\bnumber that is none\b": "say what it is, in a positive sentence",
    r"\bis chance\b|\bcame first is\b": "their ranking is not significant",
    r"\b(cannot be |be )parted\b": "separated",
    r"\bfor want of\b|\bwant of\b": "because ... is missing",
    r"\bthe weakest first\b": "backward elimination",
    r"\bbought like\b": "name the rule",
    r"\btells most\b": "is most informative",
    r"\bflat in\b": "insensitive to",
    r"\bhouse rules\b|\bthe house\b": "conventions; the code",
    r"\blab protocol\b": "experiment script",
    r"\bborn\b": "originate",
    r"\bbelieved to\b|\b(is|are) believed\b|\bto be believed\b": "accepted; trusted",
    r"\bput in (first|beforehand)\b": "added before the search",
    r"\bmend(ed|s)?\b": "corrected",
    r"\bbears? (it |them )?out\b|\bborne out\b": "supported",
    r"\bstands? (under|beside|behind|against)\b": "is listed under; is together with; follows",
}


def private_words(text: str) -> list[str]:
    """The private words of a text, each with what to write instead."""
    prose = re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)  # programs and names keep theirs
    prose = re.sub(r"\s+", " ", prose)
    return [
        f"'{hit.group()}': write '{instead}'"
        for words, instead in REPLACEMENTS.items()
        for hit in re.finditer(words, prose, flags=re.IGNORECASE)
    ]


def prose_of(path: Path) -> Iterator[str]:
    """Docstrings and comments of a Python file, and the texts of its criteria."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            yield ast.get_docstring(node) or ""
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "number":
            yield from (a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str))
    with tokenize.open(path) as file:
        yield from (token.string for token in tokenize.generate_tokens(file.readline) if token.type == tokenize.COMMENT)


def messages_of(path: Path) -> Iterator[str]:
    """Texts of more than one word in a Python file that are not docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    expressions = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        text = node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""
        if " " in text.strip() and id(node) not in expressions:
            yield text


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_has_no_private_words(page: Path) -> None:
    found = private_words(page.read_text(encoding="utf-8"))
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    "path",
    [path for glob in CODE for path in sorted(REPO.glob(glob))],
    ids=lambda path: f"{path.parent.name}/{path.name}",
)
def test_docstrings_have_no_private_words(path: Path) -> None:
    found = private_words("\n".join(prose_of(path)))
    assert not found, "\n".join(found)


@pytest.mark.parametrize("path", MESSAGES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_messages_have_no_private_words(path: Path) -> None:
    found = private_words("\n".join(messages_of(path)))
    assert not found, "\n".join(found)


def test_the_page_of_the_api_has_every_public_name() -> None:
    listed = set((REPO / "docs" / "api.md").read_text(encoding="utf-8").split())
    assert not set(casid.__all__) - {"__version__"} - listed
