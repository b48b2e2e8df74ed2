"""Reading a TOML file, with the faults of the file as input errors."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from casid.errors import InputError


def read_toml(path: str | Path) -> dict[str, Any]:
    """Content of a TOML file; raises InputError when it cannot be read or is not TOML."""
    try:
        return tomllib.loads(Path(path).read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:  # ValueError: bad TOML, bad UTF-8, a number of thousands of digits
        fault = str(error).splitlines()[0] if str(error) else "nested too deeply"
        raise InputError(f"{path}: not valid TOML: {fault}") from None
