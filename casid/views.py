"""What rooms above make of a result: it asks for a view by name, and the room is loaded only then.

This is the one way up the house: a result knows that it can be drawn, not who draws. `tests/test_house.py` holds it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any

VIEWS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "fit.predict": ("casid.filtering.predict", "predict"),
        "fit.plot": ("casid.report.fit_view", "plot"),
        "fit.frame": ("casid.report.fit_view", "frame"),
        "fit.latex": ("casid.report.fit_view", "latex"),
        "fit.html": ("casid.report.fit_view", "html"),
        "diagnosis.frame": ("casid.report.diagnosis_view", "frame"),
        "diagnosis.html": ("casid.report.diagnosis_view", "html"),
    }
)


def view(name: str) -> Callable[..., Any]:
    """The function that makes a view; its first argument is the result."""
    module, function = VIEWS[name]
    return getattr(import_module(module), function)
