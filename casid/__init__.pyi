from casid.acceptance.checks import MatchedTest
from casid.acceptance.compared import Comparison, compare_diagnoses
from casid.acceptance.fleet import Fleet, compare_flights
from casid.acceptance.handbook import Handbook, modes
from casid.acceptance.isolability import Isolability, isolability
from casid.acceptance.match import proof_of_match
from casid.acceptance.proof import ProofOfMatch
from casid.acceptance.theil import Theil, theil
from casid.acceptance.tolerances import Standard
from casid.analysis import Bootstrap, Identifiability, ProfileInterval, bootstrap, identifiability, profile
from casid.data_check.check import DataFindings as DataFindings
from casid.data_check.check import check as check
from casid.data_check.reading import Finding as Finding
from casid.design import Experiment, InputDesign, Multisine, StepInput, design_input, standard_3211
from casid.diagnosis.cause import Decision as Decision
from casid.diagnosis.cause import Trace as Trace
from casid.diagnosis.comparisons import Gate as Gate
from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.kinematics.compatibility import Compatibility, InstrumentError, SteadyWind, compatibility
from casid.diagnosis.result import Cause, Diagnosis
from casid.errors import CasidError, EstimationError, InputError
from casid.estimation import (
    Automatic,
    ChannelFit,
    Collocation,
    CombinedError,
    EquationError,
    Estimate,
    Fit,
    GaussNewton,
    Huber,
    InitialState,
    Ipopt,
    Minimum,
    MultipleShooting,
    Noise,
    OutputError,
    Population,
    Problem,
    RangeWeights,
    Results,
    SingleShooting,
    Starts,
    StateHistory,
    StudentT,
    limit_combination,
    limit_function,
    limit_parameter,
    limit_trajectory,
    solve,
)
from casid.filtering.cost import FilterError
from casid.formats.export import export
from casid.formats.fmu import fmu_model
from casid.formats.petab import read_petab
from casid.frequency.mismatch import Mismatch, MismatchEnvelope, ResponseComparison, compare_responses
from casid.frequency.model_response import LinearModel, linear_model
from casid.frequency.output_error import FourierOutputError
from casid.frequency.precision import ParameterPrecision, Precision, precision
from casid.frequency.recursive import TrackedDerivatives, track_derivatives
from casid.frequency.regression import FourierEquationError
from casid.frequency.response import FrequencyResponse, frequency_response
from casid.frequency.response_fit import MeasuredResponse, ResponseFit, ResponseParameter
from casid.frequency.state_space import fit_state_space
from casid.frequency.transfer_function import TransferFunction, fit_transfer_functions
from casid.keeping import load
from casid.model.aircraft import Aircraft, EffectValue, Inertia
from casid.model.dynamics import aircraft_model, flight_inputs
from casid.model.external import external_function
from casid.model.feedback import SampledFeedback
from casid.model.library import Library
from casid.model.port import ModelPort
from casid.model.rotors import Rotor, Rotors, Voltage
from casid.model.simulate import Simulation, simulate
from casid.model.system import Model, define_model, define_regression
from casid.model.tables import Table, table
from casid.model.trim import Trim, trim
from casid.records import ColumnMap, Record, read_record, read_records, write_record
from casid.records.segments import Segment, segments
from casid.report.page import Report, write_report
from casid.report.sections import Section

__version__: str
__all__ = [
    "__version__",
    "Aircraft",
    "Automatic",
    "Bootstrap",
    "CasidError",
    "Cause",
    "ChannelFit",
    "Collocation",
    "ColumnMap",
    "CombinedError",
    "Comparison",
    "Compatibility",
    "DataFindings",
    "Decision",
    "Diagnosis",
    "EffectValue",
    "EquationError",
    "Estimate",
    "EstimationError",
    "Experiment",
    "FilterError",
    "Finding",
    "Fit",
    "Fleet",
    "FourierEquationError",
    "FourierOutputError",
    "FrequencyResponse",
    "Gate",
    "GaussNewton",
    "Handbook",
    "Huber",
    "Identifiability",
    "Inertia",
    "InitialState",
    "InputDesign",
    "InputError",
    "InstrumentError",
    "Ipopt",
    "Isolability",
    "Library",
    "LinearModel",
    "MatchedTest",
    "MeasuredResponse",
    "Minimum",
    "Mismatch",
    "MismatchEnvelope",
    "Model",
    "ModelPort",
    "MultipleShooting",
    "Multisine",
    "Noise",
    "OutputError",
    "ParameterPrecision",
    "Population",
    "Precision",
    "Problem",
    "ProfileInterval",
    "ProofOfMatch",
    "RangeWeights",
    "Record",
    "Report",
    "ResponseComparison",
    "ResponseFit",
    "ResponseParameter",
    "Results",
    "Rotor",
    "Rotors",
    "SampledFeedback",
    "Section",
    "Segment",
    "Simulation",
    "SingleShooting",
    "Standard",
    "Starts",
    "StateHistory",
    "SteadyWind",
    "StepInput",
    "StudentT",
    "Table",
    "Theil",
    "Trace",
    "TrackedDerivatives",
    "TransferFunction",
    "Trim",
    "Voltage",
    "aircraft_model",
    "bootstrap",
    "check",
    "compare_diagnoses",
    "compare_flights",
    "compare_responses",
    "compatibility",
    "define_model",
    "define_regression",
    "design_input",
    "diagnose",
    "export",
    "external_function",
    "fit_state_space",
    "fit_transfer_functions",
    "flight_inputs",
    "fmu_model",
    "frequency_response",
    "identifiability",
    "isolability",
    "limit_combination",
    "limit_function",
    "limit_parameter",
    "limit_trajectory",
    "linear_model",
    "load",
    "modes",
    "precision",
    "profile",
    "proof_of_match",
    "read_petab",
    "read_record",
    "read_records",
    "segments",
    "simulate",
    "solve",
    "standard_3211",
    "table",
    "theil",
    "track_derivatives",
    "trim",
    "write_record",
    "write_report",
]
