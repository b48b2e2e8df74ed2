"""The estimators of the paper: three costs, and three ways to simulate, on one symbolic model.

The model inside has the true force coefficients and linear moments; the 16 moment derivatives (eq. 5) are unknown and
start at 0.7 times their true linear values. Outputs alpha, beta, p, q, r (eq. 10); equations Cl, Cm, Cn (eq. 6-8)
on measured signals; weights by range (eq. 13).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType

import casadi as ca

from casid.errors import unknown
from casid.estimation import (
    CombinedError,
    EquationError,
    Fit,
    GaussNewton,
    InitialState,
    MultipleShooting,
    OutputError,
    Problem,
    RangeWeights,
    SingleShooting,
    solve,
)
from casid.estimation.cost import Cost
from casid.model.dynamics import aircraft_model
from casid.model.feedback import SampledFeedback
from casid.model.system import EquationForm as EquationForm
from casid.model.system import Model
from problems.do328 import MOMENT_DERIVATIVES, do328
from problems.paper.truth import CM_ALPHA_DESTABILISED, COEFFICIENTS, OUTPUTS, SURFACES, Flight, control_law

START_FACTOR = 0.7
# Steady level flight comes before the manoeuvre; the first sample says the rest. u v w [m/s], p q r [rad/s], rad
INITIAL_STD = MappingProxyType(
    {"u": 0.5, "v": 1.0, "w": 1.0, "p": 0.02, "q": 0.02, "r": 0.02, "phi": 0.01, "theta": 0.01}
)
ESTIMATORS: Mapping[str, Cost] = MappingProxyType(
    {"equation": EquationError(), "output": OutputError(), "combined": CombinedError(equation_weight=0.5)}
)
INTERVAL = 25


@dataclass(frozen=True, kw_only=True)
class Method:
    """How an estimator simulates: transcription, and whether the control law is in its loop."""

    transcription: SingleShooting | MultipleShooting
    closed: bool
    words: str


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "single-closed": Method(
            transcription=SingleShooting(), closed=True, words="single shooting, control law in the loop"
        ),
        "single-open": Method(
            transcription=SingleShooting(), closed=False, words="single shooting, open loop on measured surfaces"
        ),
        "multiple-open": Method(
            # one step per sample, as the truth is flown: without noise casid would refine the steps without end
            transcription=MultipleShooting(interval=INTERVAL, substeps=1),
            closed=False,
            words=f"multiple shooting, {INTERVAL} samples each, open loop on measured surfaces",
        ),
    }
)


@cache
def estimation_model() -> Model:
    """The model inside every estimator; its nominal values are the stable aircraft's."""
    model = aircraft_model(do328(), outputs=OUTPUTS, effects=())
    channels = ("V", *OUTPUTS, *(f"surface_{name}" for name in SURFACES), *COEFFICIENTS)
    m = ca.SX.sym("m", len(channels))
    c = {name.removeprefix("surface_"): symbol for name, symbol in zip(channels, ca.vertsplit(m), strict=True)}
    p = dict(zip(model.parameters, ca.vertsplit(model.p), strict=True))
    aircraft = do328()
    regressor = c | {"0": 1.0}
    for rate, length in (("p", "lateral"), ("q", "pitch"), ("r", "lateral")):
        regressor[rate] = c[rate] * getattr(aircraft, f"rate_length_{length}") / c["V"]
    sums = [
        sum(p[name] * regressor[name.split("_", 1)[1]] for name in MOMENT_DERIVATIVES if name.startswith(coefficient))
        for coefficient in COEFFICIENTS
    ]
    equation = EquationForm(
        names=COEFFICIENTS,
        channels=channels,
        m=m,
        target=ca.vertcat(*[c[n] for n in COEFFICIENTS]),
        prediction=ca.vertcat(*sums),
    )
    return replace(model, equation=equation)


@cache
def law_in_the_estimator(Cm_alpha: float = CM_ALPHA_DESTABILISED) -> SampledFeedback:
    """Eq. 16 on the estimation model."""
    return control_law(estimation_model(), Cm_alpha)


def start_values(flight: Flight) -> dict[str, float]:
    """0.7 times the true linear values."""
    return {name: START_FACTOR * flight.derivatives[name] for name in MOMENT_DERIVATIVES}


def paper_problem(
    flight: Flight,
    cost: Cost,
    *,
    closed: bool = False,
    start: Mapping[str, float] | None = None,
    noise: Mapping[str, float] | str = "range",
) -> Problem:
    """The estimation problem of one record. closed: the control law in the loop, on the measured stick.
    noise: 1-sigma by channel, or "range": weights by range (eq. 13), or "residuals": estimated with the parameters."""
    law = law_in_the_estimator(flight.derivatives["Cm_alpha"]) if closed and flight.destabilised else None
    return Problem(
        estimation_model(),
        [flight.commands if law else flight.surfaces],
        free=list(MOMENT_DERIVATIVES),
        start=start_values(flight) if start is None else start,
        cost=cost,
        noise={"range": RangeWeights(), "residuals": None}[noise] if isinstance(noise, str) else noise,
        initial_state=InitialState(std=INITIAL_STD),
        feedback=law,
    )


def estimate(flight: Flight, estimator: str, method: str) -> Fit:
    """One estimation of Table 5. Raises InputError for an estimator or method that does not exist."""
    if estimator not in ESTIMATORS:
        raise unknown("estimator", estimator, ESTIMATORS)
    if method not in METHODS:
        raise unknown("method", method, METHODS)
    how = METHODS[method]
    problem = paper_problem(flight, ESTIMATORS[estimator], closed=how.closed)
    return solve(problem, how.transcription, GaussNewton(iterations=100))
