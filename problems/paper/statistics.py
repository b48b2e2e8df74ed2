"""What is compared in Table 5: departures, and the statistics of eq. 17, for one estimate.

A departure is judged in the same way for every estimator and every method, linear and nonlinear truth alike. A run
has departed when one of two motions does not stay finite and inside ENVELOPE from the first sample to the last: the
one that the estimator itself ended with (pure equation error simulates none), and the flight of the model with the
estimate from the true start by the exact stick, with the aircraft's control law in the loop where it has one. Whether
a solver reports success plays no part; runs that did not converge are counted apart. With nonlinear truth the linear
model cannot be right; a departure then means that the estimator lost the motion, or that its estimate cannot even be
flown through the manoeuvre that it was estimated from.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

import casadi as ca
import numpy as np

from casid.estimation.transcriptions.steps import output_function, step_function
from problems.do328 import MOMENT_DERIVATIVES
from problems.paper.estimation import estimation_model, law_in_the_estimator
from problems.paper.truth import COEFFICIENTS, OUTPUTS, SURFACES, Flight, regressors

# |value| of the simulated motion; the true flights stay below 0.06, 0.15 rad and 0.8, 0.15, 0.35 rad/s
ENVELOPE: Mapping[str, float] = MappingProxyType({"alpha": 0.5, "beta": 0.5, "p": 3.0, "q": 1.5, "r": 1.5})
_SHORT = MappingProxyType({"delta_a": "da", "delta_e": "de", "delta_r": "dr"})


def paper_name(derivative: str) -> str:
    """Name of a derivative in the paper's table: Cl_delta_a -> Clda."""
    coefficient, variable = derivative.split("_", 1)
    return coefficient + _SHORT.get(variable, variable)


DERIVATIVE_STATISTICS = tuple(paper_name(name) for name in MOMENT_DERIVATIVES)
MATCHES = (
    *(f"match_{c}_1e-6" for c in COEFFICIENTS),
    "match_alpha_deg",
    "match_beta_deg",
    *(f"match_{rate}_deg_s" for rate in "pqr"),
)
STATISTICS = (*DERIVATIVE_STATISTICS, *MATCHES)


@cache
def _flight_function(destabilised: bool, Cm_alpha: float, count: int) -> ca.Function:
    """(start, commands, dt, parameters) -> outputs at all samples."""
    model = estimation_model()
    step = step_function(model, law_in_the_estimator(Cm_alpha) if destabilised else None)
    x0, u = ca.MX.sym("x0", len(model.states)), ca.MX.sym("u", len(model.inputs), count)
    dt, p = ca.MX.sym("dt", 1, count - 1), ca.MX.sym("p", len(model.parameters))
    after = step.mapaccum("fly", count - 1)(x0, u[:, :-1], u[:, :-1], dt, ca.repmat(p, 1, count - 1))
    y = output_function(model).map(count)(ca.horzcat(x0, after), u, ca.repmat(p, 1, count))
    return ca.Function("flight", [x0, u, dt, p], [y])


def simulated(flight: Flight, estimate: Mapping[str, float]) -> np.ndarray:
    """(N, outputs) motion alpha, beta [rad], p, q, r [rad/s] of the linear model with the estimate."""
    model, exact = estimation_model(), flight.exact
    commands = exact.matrix([f"stick_{name}" if name in SURFACES else name for name in model.inputs])
    function = _flight_function(flight.destabilised, flight.derivatives["Cm_alpha"], len(exact))
    parameters = model.nominal_vector(dict(estimate))
    return function(flight.states[0], commands.T, np.diff(exact.t)[None], parameters).full().T


def departed(motion: np.ndarray) -> bool:
    """Whether a motion (N, outputs) leaves the envelope or the numbers."""
    limits = np.array([ENVELOPE[name] for name in OUTPUTS])
    return not bool(np.isfinite(motion).all() and (np.abs(motion) <= limits).all())


def linear_contributions(flight: Flight, estimate: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Moment derivative -> (N,) its term with the estimate, along the true flight."""
    x = true_regressors(flight)
    return {name: estimate[name] * x[name.split("_", 1)[1]] for name in MOMENT_DERIVATIVES}


def coefficients(contributions: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Cl, Cm, Cn -> (N,) sum of the contributions of its derivatives."""
    return {
        c: np.sum([values for name, values in contributions.items() if name.startswith(c)], axis=0)
        for c in COEFFICIENTS
    }


def true_regressors(flight: Flight) -> dict[str, np.ndarray]:
    """Variable -> (N,) flow angles and surfaces [rad], dimensionless rates of the true flight; "0" is one."""
    rows = _regressor_function(len(flight.exact))(flight.states.T).full()
    return (
        dict(zip(OUTPUTS, rows, strict=True)) | {s: flight.exact[s] for s in SURFACES} | {"0": np.ones(rows.shape[1])}
    )


@cache
def _regressor_function(count: int) -> ca.Function:
    """states -> alpha, beta [rad], dimensionless p, q, r at all samples."""
    model = estimation_model()
    seen = regressors(model)
    return ca.Function("regressors", [model.x], [ca.vertcat(*[seen[name] for name in OUTPUTS])]).map(count)


def statistics(flight: Flight, estimate: Mapping[str, float], motion: np.ndarray) -> dict[str, float]:
    """Eq. 17 against noise-free truth, by the names of Table 5.

    derivatives   relative r.m.s. error of the term's contribution; absolute error of an offset
    match_C       1e6 * mean |coefficient of the linear model on the true signals - true coefficient|
    match_output  mean |simulated - true| [deg, deg/s]
    """
    contributions = linear_contributions(flight, estimate)
    found = {}
    for name in MOMENT_DERIVATIVES:
        error, true = contributions[name] - flight.contributions[name], flight.contributions[name]
        offset = name.endswith("_0")
        found[paper_name(name)] = float(np.abs(error[0]) if offset else np.sqrt((error**2).sum() / (true**2).sum()))
    for c, modelled in coefficients(contributions).items():
        found[f"match_{c}_1e-6"] = 1e6 * float(np.abs(modelled - flight.coefficients[c]).mean())
    true = flight.exact.matrix(OUTPUTS)
    means = np.degrees(np.abs(motion - true).mean(axis=0))
    return found | dict(zip(MATCHES[len(COEFFICIENTS) :], means.tolist(), strict=True))
