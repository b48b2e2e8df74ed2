"""Write and print what a command found."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from casid.report.folder import whole_folder


def write_json(content: Mapping[str, Any], path: Path) -> str:
    """Write a file of JSON, and return its text."""
    text = json.dumps(content, indent=1)
    path.write_text(f"{text}\n", encoding="utf-8")
    return text


def tell(name: str, found: Any, out: Path | None, as_json: bool, write_page: Callable[[Any, Path], None]) -> None:
    """Print a result, or the JSON of it alone; into a folder, if there is one, go its page and NAME.json."""
    if out is not None:
        with whole_folder(out) as folder:
            write_page(found, folder)
            write_json(found.to_dict(), folder / f"{name}.json")
    print(json.dumps(found.to_dict(), indent=1) if as_json else found)
