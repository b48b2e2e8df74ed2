"""Reading a TOML file, with the faults of the file as input errors."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from casid.errors import InputError
from casid.records.limits import MOST_BYTES_OF_A_MODEL, read_bytes


def read_toml(path: str | Path) -> dict[str, Any]:
    """Content of a TOML file; raises InputError when it cannot be read or is not TOML."""
    raw = read_bytes(Path(path), MOST_BYTES_OF_A_MODEL)
    try:
        return tomllib.loads(raw.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:  # ValueError: bad TOML, bad UTF-8, a number of thousands of digits
        fault = str(error).splitlines()[0] if str(error) else "nested too deeply"
        raise InputError(f"{path}: not valid TOML: {fault}") from None
