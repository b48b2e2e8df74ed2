"""Estimation: cost x transcription x solver, chosen independently of each other."""

from casid.estimation.bootstrap import Bootstrap, bootstrap, collected, drawn_problem, replica
from casid.estimation.constraints import linear, parameter, path
from casid.estimation.cost import CombinedError, EquationError, OutputError, RangeWeights
from casid.estimation.estimate import solve
from casid.estimation.feedback import SampledFeedback
from casid.estimation.fit import ChannelFit, Estimate, Fit, StateHistory
from casid.estimation.gauss_newton import GaussNewton
from casid.estimation.identifiability import Identifiability, identifiability
from casid.estimation.input_design import Experiment, InputDesign, design_input, standard_3211
from casid.estimation.input_noise import InputErrors, input_noise_errors, with_noisy_inputs
from casid.estimation.input_shapes import Multisine, Steps
from casid.estimation.ipopt import Ipopt
from casid.estimation.newton import Automatic
from casid.estimation.problem import InitialState, Problem
from casid.estimation.profile import ProfileInterval, profile
from casid.estimation.transcription import Collocation, MultipleShooting, SingleShooting

__all__ = [
    "Automatic", "Bootstrap", "ChannelFit", "Collocation", "CombinedError", "EquationError", "Estimate", "Experiment",
    "Fit", "GaussNewton", "Identifiability", "InitialState", "InputDesign", "InputErrors", "Ipopt", "MultipleShooting",
    "Multisine", "OutputError", "Problem", "ProfileInterval", "RangeWeights", "SampledFeedback", "SingleShooting",
    "StateHistory", "Steps", "bootstrap", "collected", "design_input", "drawn_problem", "identifiability",
    "input_noise_errors", "linear", "parameter", "path", "profile", "replica", "solve", "standard_3211",
    "with_noisy_inputs",
]  # fmt: skip
