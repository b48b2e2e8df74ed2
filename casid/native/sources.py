"""The C sources of the package, by name."""

from __future__ import annotations

from functools import cache
from importlib.resources import files


@cache
def c_source(name: str) -> str:
    """The text of ``casid/native/c/NAME.c``."""
    return files("casid.native").joinpath("c", f"{name}.c").read_text(encoding="utf-8")
