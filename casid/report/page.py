"""The report: one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from casid.diagnosis.result import Diagnosis

_PAGE = Template("""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>$title</title></head>
<body><h1>$title</h1><p>$sentence</p></body></html>
""")


def write_report(diagnosis: Diagnosis, folder: str | Path, made_with: Mapping[str, Any]) -> None:
    """Write report.html into `folder`."""
    page = _PAGE.substitute(title=escape(diagnosis.aircraft.name), sentence=escape(diagnosis.sentence))
    (Path(folder) / "report.html").write_text(page, encoding="utf-8")
