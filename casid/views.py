"""Functions of rooms above, by name: views of results, and readers and writers of other simulators' files.

A room is loaded when its function is called. This is the only way up: a result knows that it can be drawn, but not who
draws it. `tests/test_house.py` holds this rule.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from importlib import import_module
from types import MappingProxyType
from typing import Any

VIEWS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "fit.predict": ("casid.filtering.predict", "predict"),
        "fit.plot": ("casid.report.estimate_figures", "plot_fit"),
        "modes.plot": ("casid.report.modes_page", "plot"),
        "isolability.plot": ("casid.report.isolability_page", "plot"),
        "isolability.text": ("casid.report.isolability_page", "text"),
        "budget.plot": ("casid.report.budget_figures", "plot"),
        "response.plot": ("casid.report.response_figures", "plot_response"),
        "response_fit.plot": ("casid.report.response_figures", "plot"),
        "comparison.plot": ("casid.report.response_figures", "plot_comparison"),
        "match.plot": ("casid.report.match_page", "plot"),
        "match.report": ("casid.report.match_page", "write_match"),
        "jsbsim.aircraft": ("casid.formats.jsbsim.aircraft", "fields_of_jsbsim"),
        "jsbsim.aerodynamics": ("casid.formats.jsbsim.aircraft", "aerodynamics_of"),
        "jsbsim.write": ("casid.formats.jsbsim.write", "rewritten"),
        "daveml.aircraft": ("casid.formats.daveml.aircraft", "fields_of_daveml"),
        "daveml.aerodynamics": ("casid.formats.daveml.aircraft", "dave_aerodynamics"),
        "daveml.write": ("casid.formats.daveml.aircraft", "rewritten"),
    }
)


def view(name: str) -> Callable[..., Any]:
    """The function of that name; the first argument of a view is the result."""
    module, function = VIEWS[name]
    return getattr(import_module(module), function)


def brief(self: Any) -> str:
    """The `repr` of a dataclass with arrays and tables in it, in a few lines: what it has, not all its numbers."""
    inside = (f"{f.name}={_short(getattr(self, f.name))}" for f in fields(self) if not f.name.startswith("_"))
    return f"{type(self).__name__}({', '.join(inside)})"


def _short(value: Any) -> str:
    if getattr(value, "shape", ()) != ():
        return f"<{type(value).__name__} {'x'.join(map(str, value.shape))}>"
    if isinstance(value, Mapping) and len(value) > 3:
        return f"<{len(value)} by name: {', '.join(map(str, list(value)[:3]))}, ...>"
    if isinstance(value, (tuple, list)) and len(value) > 3:
        return f"<{len(value)} of {type(value[0]).__name__}>"
    text = repr(value)
    return text if len(text) <= 120 and "\n" not in text else f"<{type(value).__name__}>"
