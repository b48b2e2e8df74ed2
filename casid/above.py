"""Load what a value needs of modules above its own: a figure, a prediction, an extended model, a file that is read.

One table of names, by which a module is loaded at its first use. No room imports one above it, not even inside a
function; `tests/test_house.py` compares this table with the calls.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any

# class and method, or function, that asks -> function that does it
DONE_BY: Mapping[str, str] = MappingProxyType(
    {
        "Aircraft.from_daveml": "casid.formats.daveml.aircraft.fields_of_daveml",
        "Aircraft.from_jsbsim": "casid.formats.jsbsim.aircraft.fields_of_jsbsim",
        "Budget.plot": "casid.report.budget_figures.plot",
        "Fit.plot": "casid.report.estimate_figures.plot_fit",
        "Fit.predict": "casid.filtering.predict.predict",
        "FrequencyResponse.plot": "casid.report.response_figures.plot_response",
        "Handbook.plot": "casid.report.modes_page.plot",
        "Isolability.__str__": "casid.report.isolability_page.text",
        "Isolability.plot": "casid.report.isolability_page.plot",
        "JsbsimAerodynamics.rewritten": "casid.formats.jsbsim.write.extended_text",
        "Model.ready": "casid.model.with_effects.ready",
        "Model.with_effects": "casid.model.with_effects.with_effects",
        "ProofOfMatch.plot": "casid.report.match_page.plot",
        "ProofOfMatch.report": "casid.report.match_page.write_match",
        "ResponseComparison.plot": "casid.report.response_figures.plot_comparison",
        "ResponseFit.plot": "casid.report.response_figures.plot",
        "read_aerodynamics: daveml": "casid.formats.daveml.aircraft.dave_aerodynamics",
        "read_aerodynamics: jsbsim": "casid.formats.jsbsim.aircraft.aerodynamics_of",
    }
)


def ask_above(asks: str, *given: Any) -> Any:
    """Call the function that does what `asks` names with what is `given`."""
    module, _, function = DONE_BY[asks].rpartition(".")
    return getattr(import_module(module), function)(*given)
