"""An aircraft as a caller gives it: the object, or its file."""

from __future__ import annotations

from typing import Any

from casid.arguments import given, is_path
from casid.errors import InputError
from casid.model.aircraft import Aircraft


def given_aircraft(value: Any, where: str) -> Aircraft:
    """An aircraft, or that of a file; InputError for anything else."""
    if isinstance(value, Aircraft):
        return value
    if is_path(value):
        return Aircraft.read(value)
    raise InputError(f"{where}: aircraft is {given(value)}; expected a cs.Aircraft or the name of its file")
