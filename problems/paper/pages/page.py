"""A plain page for the result of an experiment: headings, sentences, tables, figures; one self-contained HTML file."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from casid.report.figure import Picture
from casid.report.svg import svg as painted

_STYLE = """
* { box-sizing: border-box; }
html { background: #fff; color: #1c1c1c; font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
body { max-width: 60rem; margin: 0 auto; padding: 1.2rem 1rem 4rem; overflow-wrap: break-word; }
h1 { font-size: 1.5rem; line-height: 1.25; margin: 0 0 .6rem; }
h2 { font-size: 1.25rem; margin: 2.4rem 0 .4rem; border-top: 2px solid #1c1c1c; padding-top: .6rem; }
figure { margin: 1rem 0 1.8rem; } figure img { display: block; width: 100%; max-width: 48rem; height: auto; }
figcaption, caption { color: #444; font-size: .92rem; text-align: left; }
caption { padding-bottom: .3rem; font-weight: 600; }
.wide { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: .88rem; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .2rem .7rem .2rem 0; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child, th.text, td.text { text-align: left; }
td.short { white-space: nowrap; }
@media print { .wide { overflow: visible; } tr, figure { break-inside: avoid; } h2 { break-after: avoid; } }
"""


_SHORT = 16  # characters of a text that stays on one line


@dataclass(frozen=True, kw_only=True)
class Section:
    """A heading and what stands below it, as HTML from `paragraph`, `table`, `figure`."""

    title: str
    parts: Sequence[str]


def paragraph(text: str) -> str:
    return f"<p>{escape(text)}</p>"


def table(head: Sequence[str], rows: Iterable[Sequence[Any]], caption: str = "") -> str:
    """Numbers to three digits, texts as they are, None as a dash."""
    rows = list(rows)
    texts = [all(isinstance(row[i], str) for row in rows) for i in range(len(head))] if rows else [False] * len(head)
    kinds = [" class='text'" if text else "" for text in texts]
    top = "".join(f"<th scope='col'{kind}>{escape(text)}</th>" for kind, text in zip(kinds, head, strict=True))
    body = "".join("<tr>" + "".join(_cell(value) for value in row) + "</tr>" for row in rows)
    named = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<div class='wide'><table>{named}<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"


def _cell(value: Any) -> str:
    if isinstance(value, str):
        return f"<td class='text{' short' if len(value) <= _SHORT else ''}'>{escape(value)}</td>"
    return f"<td>{number(value)}</td>"


def number(value: float | int | None) -> str:
    """Three significant digits; whole numbers whole; None and NaN a dash."""
    if value is None or value != value:
        return "–"
    if isinstance(value, int):
        return str(value)
    return f"{value:.3g}".replace("-", "−")


def figure(picture: Picture, svg: bytes | None = None) -> str:
    """The picture inside the page; `svg` where it has been drawn already."""
    data = base64.b64encode(painted(picture.figure) if svg is None else svg).decode("ascii")
    return (
        f"<figure><h3>{escape(picture.title)}</h3><img src='data:image/svg+xml;base64,{data}' "
        f"alt='{escape(picture.alt)}'><figcaption>{escape(picture.caption)}</figcaption></figure>"
    )


def write_page(
    path: str | Path, title: str, lead: Sequence[str], sections: Sequence[Section], made_with: Mapping[str, Any]
) -> None:
    """Write the page; `lead` are sentences under the title, `made_with` as from `provenance`."""
    body = [f"<h1>{escape(title)}</h1>", *map(paragraph, lead)]
    for section in sections:
        body += [f"<h2>{escape(section.title)}</h2>", *section.parts]
    facts = "; ".join(f"{key}: {_plain(value)}" for key, value in made_with.items() if value is not None)
    body.append(f"<h2>How this was made</h2>{paragraph(facts)}")
    text = (
        f"<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        f"<meta name='viewport' content='width=device-width, initial-scale=1'><title>{escape(title)}</title>"
        f"<link rel='icon' href='data:,'><style>{_STYLE}</style></head><body>\n"
        + "\n".join(body)
        + "\n</body></html>\n"
    )
    Path(path).write_text(text, encoding="utf-8")


def _plain(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {one}" for key, one in value.items())
    return " ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
