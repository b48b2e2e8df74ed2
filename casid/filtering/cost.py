"""Filter error: the cost of a problem with process noise, the innovations of a Kalman filter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from casid.arguments import number, numbers_by_name
from casid.errors import EstimationError, check_known
from casid.estimation.problem import Problem
from casid.estimation.transcriptions.transcription import MultipleShooting
from casid.filtering.likelihood import FilterLikelihood
from casid.model.system import check_continuous


@dataclass(frozen=True, kw_only=True)
class FilterError:
    """Innovations of a Kalman filter: output error in turbulence, or with noisy inputs.

    Parameters, measurement noise (that of `Problem.noise`, or estimated) and process noise are estimated together by
    maximum likelihood. Initial states are free with a wide prior. `Fit.process_noise` has what was found,
    `Fit.innovations` the whitened innovations; `Fit.predictions` are from one sample to the next, and `Fit.states` are
    smoothed. The time constant of a lag runs off to infinity from a start of the wrong sign, where the data say nothing
    of it; the iteration then starts again with the other sign.

    Attributes
    ----------
    process_noise
        Disturbance of the model -> correlation time [s] of the Gauss-Markov process that drives it; 0: white from
        sample to sample. None at all: output error.
    sigma
        Disturbance -> 1-sigma of its process noise, where that is known. With all of them, the noise of the outputs and
        `fixed` values of all parameters, a solution is the one-step prediction of records that no fit has seen.

    Raises
    ------
    InputError
        For a name that is no disturbance and a number that is negative.

    Examples
    --------
    >>> import numpy as np, casid as cs
    >>> lag = cs.define_model(
    ...     "lag", states=["x"], inputs=["u"], parameters={"T": 0.5}, outputs=["y"], disturbances=["w_x"],
    ...     dynamics=lambda s: {"x": (s.u - s.x) / s.T + s.w_x}, output=lambda s: {"y": s.x},
    ... )
    >>> t, rng = 0.05 * np.arange(200), np.random.default_rng(1)
    >>> square = cs.Record(name="square", t=t, channels={"u": np.sign(np.sin(t))})
    >>> gust = {"w_x": 0.5 * rng.standard_normal(len(t))}
    >>> flown = cs.simulate(lag, square, [0.0], {"T": 0.4}, gust).as_record("flown")
    >>> noisy = flown.with_channels(y=flown["y"] + 0.02 * rng.standard_normal(len(t)))
    >>> cost = cs.FilterError(process_noise={"w_x": 0.0})
    >>> fit = cs.solve(cs.Problem(model=lag, records=[noisy], free=["T"], cost=cost))
    >>> fit.status, round(fit.values["T"], 1)
    ('converged', 0.4)
    """

    process_noise: Mapping[str, float] = field(default_factory=dict)
    sigma: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, tau in numbers_by_name(self.process_noise, "FilterError: process_noise").items():
            number(tau, f"FilterError: process_noise: correlation time [s] of '{name}'", least=0.0)
        for name, sigma in numbers_by_name(self.sigma, "FilterError: sigma").items():
            check_known("disturbance of process_noise", (name,), self.process_noise, "FilterError: sigma")
            number(sigma, f"FilterError: sigma of '{name}'", positive=True)

    def check(self, problem: Problem) -> None:
        """Raise InputError or EstimationError for a problem that it does not take."""
        model = problem.model
        if not model.disturbances:
            raise EstimationError(
                f"FilterError: model '{model.name}' has no disturbance that process noise could drive"
            )
        check_known("disturbance", tuple(self.process_noise), model.disturbances, "FilterError: process_noise")
        check_continuous(model, "FilterError")
        if problem.noise is not None and not isinstance(problem.noise, Mapping):
            raise EstimationError("FilterError: takes independent noise of the outputs, given by name or estimated")
        if problem.initial_state.value or problem.initial_state.std:
            raise EstimationError("FilterError: initial states are free with a wide prior; leave initial_state out")
        for found, words in (
            (problem.noise_formulas, "noise by formula"),
            (problem.path_constraints, "limits of states and outputs"),
            (problem.feedback is not None, "a control law in the loop"),
            (model.initial, "initial states by formula"),
            (problem.events, "events"),
            (problem.spread, "parameters drawn from a distribution"),
        ):
            if found:
                raise EstimationError(f"FilterError: {words} is not taken here; use OutputError()")

    def likelihood(self, problem: Problem) -> Any:
        """Return the innovations of a problem."""
        return FilterLikelihood(problem, self.process_noise, self.sigma)

    def check_method(self, method: Any) -> None:
        """Raise EstimationError for a transcription: the filter has its own."""
        options = (getattr(method, name, None) for name in ("process_noise", "substeps", "implicit"))
        if not isinstance(method, MultipleShooting) or any(options):
            raise EstimationError(
                "solve: FilterError has a state at every sample, one explicit step apart, and its own process noise; "
                f"leave {type(method).__name__} and its options out"
            )
