"""Identification of aircraft from flight data.

What to call, in the order of the work; `help(casid.solve)` and the like tell more, each with an example:

- `read_records("flight/m*.csv")`: flight records, in SI units and radians.
- `Aircraft.read("aircraft.toml")`: the simulation, as an aircraft file; `define_model` makes one of any system.
- `check(records, aircraft)`: faults of the data, such as signs, units, swaps, frozen samples.
- `diagnose(aircraft, records)`: the causes of its differences from flight; `write_report` writes a page.
- `aircraft_model(aircraft)` and `flight_inputs(aircraft, record)`: model and records for an estimation of your own.
- `solve(Problem(model=..., records=..., free=[...]))`: parameters with their standard errors, a `Fit`.
- `identifiability(fit)`, `profile(fit, names)` and `bootstrap(fit, runs, seed)`: how well they are determined.
- `frequency_response(records, input, output)` and `compare_responses`: flight and models by frequency.
- `proof_of_match(aircraft, records)`: whether the simulation is within the tolerances of a simulator standard.
- `modes(aircraft)`: natural modes and handling qualities from the simulation.

The public names are those of `__init__.pyi`; each loads its package at its first use, so that `import casid` is quick.
"""

import ast
from importlib import import_module
from pathlib import Path

__version__ = "0.1.0"

# name -> module, from the file that type checkers read
_STUB = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
_IMPORTS = [node for node in _STUB.body if isinstance(node, ast.ImportFrom)]
_HOME = {alias.name: str(node.module) for node in _IMPORTS for alias in node.names}
__all__ = ["__version__", *sorted(_HOME)]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'casid' has no attribute '{name}'")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
