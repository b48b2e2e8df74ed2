"""Estimation: cost x transcription x solver, chosen independently of each other."""

from casid.estimation.constraints import limit_combination, limit_function, limit_parameter, limit_trajectory
from casid.estimation.cost import CombinedError, EquationError, OutputError, RangeWeights
from casid.estimation.estimate import solve
from casid.estimation.fit import Fit
from casid.estimation.fitted import ChannelFit, Estimate, Minimum, Population, Starts, StateHistory
from casid.estimation.initial_state import InitialState
from casid.estimation.noise import Huber, Noise, StudentT
from casid.estimation.problem import Problem
from casid.estimation.solvers.gauss_newton import GaussNewton
from casid.estimation.solvers.ipopt import Ipopt
from casid.estimation.solvers.newton import Automatic
from casid.estimation.solvers.status import Results
from casid.estimation.transcriptions.transcription import Collocation, MultipleShooting, SingleShooting
