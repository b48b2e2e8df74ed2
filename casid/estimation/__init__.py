"""Estimation: cost x transcription x solver, chosen independently of each other."""

from casid.estimation.constraints import linear, parameter, path
from casid.estimation.cost import CombinedError, EquationError, OutputError, RangeWeights
from casid.estimation.estimate import solve
from casid.estimation.feedback import SampledFeedback
from casid.estimation.fit import ChannelFit, Estimate, Fit, StateHistory
from casid.estimation.gauss_newton import GaussNewton
from casid.estimation.ipopt import Ipopt
from casid.estimation.problem import InitialState, Problem
from casid.estimation.transcription import Collocation, MultipleShooting, SingleShooting

__all__ = [
    "ChannelFit", "Collocation", "CombinedError", "EquationError", "Estimate", "Fit", "GaussNewton", "InitialState",
    "Ipopt", "MultipleShooting", "OutputError", "Problem", "RangeWeights", "SampledFeedback", "SingleShooting",
    "StateHistory", "linear", "parameter", "path", "solve",
]  # fmt: skip
