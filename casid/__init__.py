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

The public names below load their package when they are first used, so that `import casid` is quick. Their types are in
`__init__.pyi`.
"""

from importlib import import_module

__version__ = "0.1.0"

_ROOMS = {
    "casid.errors": (
        "CasidError",
        "EstimationError",
        "InputError",
    ),
    "casid.keeping": ("load",),
    "casid.records": (
        "ColumnMap",
        "Record",
        "read_record",
        "read_records",
        "write_record",
    ),
    "casid.records.segments": (
        "Segment",
        "segments",
    ),
    "casid.model.aircraft": (
        "Aircraft",
        "EffectValue",
        "Inertia",
    ),
    "casid.model.dynamics": (
        "aircraft_model",
        "flight_inputs",
    ),
    "casid.model.feedback": ("SampledFeedback",),
    "casid.formats.fmu": ("fmu_model",),
    "casid.model.port": ("ModelPort",),
    "casid.model.external": ("external_function",),
    "casid.model.rotors": (
        "Rotor",
        "Rotors",
        "Voltage",
    ),
    "casid.model.simulate": (
        "Simulation",
        "simulate",
    ),
    "casid.model.system": (
        "Model",
        "define_model",
        "define_regression",
    ),
    "casid.model.tables": (
        "Table",
        "table",
    ),
    "casid.model.trim": (
        "Trim",
        "trim",
    ),
    "casid.estimation": (
        "Automatic",
        "ChannelFit",
        "Collocation",
        "CombinedError",
        "EquationError",
        "Estimate",
        "Fit",
        "GaussNewton",
        "Huber",
        "InitialState",
        "Ipopt",
        "Minimum",
        "MultipleShooting",
        "Noise",
        "OutputError",
        "Population",
        "Problem",
        "RangeWeights",
        "Results",
        "SingleShooting",
        "Starts",
        "StateHistory",
        "StudentT",
        "limit_combination",
        "limit_function",
        "limit_parameter",
        "limit_trajectory",
        "solve",
    ),
    "casid.formats.petab": ("read_petab",),
    "casid.filtering.filter_error": (
        "FilterFit",
        "filter_error",
    ),
    "casid.analysis": (
        "Bootstrap",
        "Identifiability",
        "ProfileInterval",
        "bootstrap",
        "identifiability",
        "profile",
    ),
    "casid.acceptance.handbook": (
        "Handbook",
        "modes",
    ),
    "casid.acceptance.isolability": (
        "Isolability",
        "isolability",
    ),
    "casid.acceptance.match": ("proof_of_match",),
    "casid.acceptance.matched": ("MatchedTest",),
    "casid.acceptance.proof": ("ProofOfMatch",),
    "casid.acceptance.theil": (
        "Theil",
        "theil",
    ),
    "casid.acceptance.tolerances": ("Standard",),
    "casid.frequency.output_error": ("FourierOutputError",),
    "casid.frequency.precision": (
        "ParameterPrecision",
        "Precision",
        "precision",
    ),
    "casid.frequency.recursive": (
        "TrackedDerivatives",
        "track_derivatives",
    ),
    "casid.frequency.response_fit": (
        "MeasuredResponse",
        "ResponseFit",
        "ResponseParameter",
    ),
    "casid.frequency.state_space": ("fit_state_space",),
    "casid.frequency.transfer_function": (
        "TransferFunction",
        "fit_transfer_functions",
    ),
    "casid.frequency.regression": ("FourierEquationError",),
    "casid.design": (
        "Experiment",
        "InputDesign",
        "Multisine",
        "StepInput",
        "design_input",
        "standard_3211",
    ),
    "casid.frequency.mismatch": (
        "Mismatch",
        "MismatchEnvelope",
        "ResponseComparison",
        "compare_responses",
    ),
    "casid.frequency.model_response": (
        "LinearModel",
        "linear_model",
    ),
    "casid.frequency.response": (
        "FrequencyResponse",
        "frequency_response",
    ),
    "casid.formats.export": ("export",),
    "casid.data_check.check": (
        "DataFindings",
        "check",
    ),
    "casid.data_check.reading": ("Finding",),
    "casid.diagnosis.kinematics.compatibility": (
        "Compatibility",
        "InstrumentError",
        "SteadyWind",
        "compatibility",
    ),
    "casid.diagnosis.cause": (
        "Decision",
        "Gate",
        "Trace",
    ),
    "casid.diagnosis.diagnose": ("diagnose",),
    "casid.diagnosis.systems.library": ("Library",),
    "casid.diagnosis.result": (
        "Cause",
        "Diagnosis",
    ),
    "casid.report.page": ("write_report",),
}
# former name -> name, for one release
_HOME = {name: room for room, names in _ROOMS.items() for name in names}
__all__ = ["__version__", *sorted(_HOME)]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'casid' has no attribute '{name}'")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
