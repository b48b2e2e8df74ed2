"""The simulated aircraft of the paper: truth with nonlinear terms, control law (eq. 16), measurement noise (Table 4).

The control law is digital: it reads the state at a sample and holds its output until the next. Truth is integrated by
the estimator's own step (Runge-Kutta of fourth order, one per sample), so that without noise an exact estimate exists.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType

import casadi as ca
import numpy as np

from casid.errors import InputError
from casid.estimation.transcriptions.steps import step_function
from casid.model.dynamics import aircraft_model
from casid.model.feedback import SampledFeedback
from casid.model.system import Model
from casid.model.trim import Trim, trim
from casid.records.record import Record
from problems.do328 import DESTABILISED, MOMENT_DERIVATIVES, STABLE, THRUST, V_TRIM, do328
from problems.manoeuvres import sample_times, stick
from problems.paper.cases import CASES, Condition
from problems.paper.nonlinear import increments

OUTPUTS = ("alpha", "beta", "p", "q", "r")
COEFFICIENTS = ("Cl", "Cm", "Cn")
SURFACES = ("delta_e", "delta_a", "delta_r")
# Table 4: noise amplitude / largest excursion of the signal from trim; of V itself for V. White and normal; the
# amplitude is three standard deviations (the paper does not say which multiple). The paper's nx ny nz, cx cy cz take
# no part in any of its three estimators.
NOISE: Mapping[str, float] = MappingProxyType(
    {
        "V": 0.005,
        "alpha": 0.05,
        "beta": 0.10,
        "delta_e": 0.05,
        "delta_a": 0.05,
        "delta_r": 0.05,
        "p": 0.025,
        "q": 0.025,
        "r": 0.025,
        "Cl": 0.20,
        "Cm": 0.01,
        "Cn": 0.02,
    }
)
SIGMAS_PER_AMPLITUDE = 3.0
CM_ALPHA_DESTABILISED = DESTABILISED["Cm_alpha"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """One simulated record and the truth behind it.

    surfaces        measured record whose inputs are the measured surfaces, held over each sample
    commands        the same with the measured stick as inputs, for a simulation with the control law in the loop;
                    both have the measured surfaces as channels "surface_delta_e", ..., for the equation error
    exact           the stick without noise and the true signals; time history of `states` (N, 8)
    coefficients    Cl, Cm, Cn -> (N,) truth
    contributions   moment derivative -> (N,) its term's true contribution to its coefficient
    derivatives     linear truth
    """

    condition: Condition
    surfaces: Record
    commands: Record
    exact: Record
    states: np.ndarray
    coefficients: Mapping[str, np.ndarray]
    contributions: Mapping[str, np.ndarray]
    derivatives: Mapping[str, float]

    @property
    def destabilised(self) -> bool:
        return CASES[self.condition.case].destabilised


def derivatives_of(destabilised: bool, Cm_alpha: float = CM_ALPHA_DESTABILISED) -> dict[str, float]:
    """Table 2, or Table 3 with its misprinted Cm_alpha as given."""
    return DESTABILISED | {"Cm_alpha": Cm_alpha} if destabilised else dict(STABLE)


@cache
def trim_point() -> Trim:
    """Steady flight of the stable aircraft, and of the destabilised one with its control law, at the same stick."""
    return trim(do328(), V=V_TRIM, thrust=THRUST)


def regressors(model: Model) -> dict[str, ca.SX]:
    """Air data, dimensionless rates and surfaces of an aircraft model, as expressions in its x and u."""
    x = dict(zip(model.states, ca.vertsplit(model.x), strict=True))
    V = ca.sqrt(x["u"] ** 2 + x["v"] ** 2 + x["w"] ** 2)
    aircraft = do328()
    lateral, pitch = aircraft.rate_length_lateral / V, aircraft.rate_length_pitch / V
    surfaces = {name: model.u[model.inputs.index(name)] for name in SURFACES}
    return {
        "V": V,
        "alpha": ca.atan2(x["w"], x["u"]),
        "beta": ca.asin(x["v"] / V),
        "p": x["p"] * lateral,
        "q": x["q"] * pitch,
        "r": x["r"] * lateral,
        **surfaces,
    }


def control_law(model: Model, Cm_alpha: float = CM_ALPHA_DESTABILISED) -> SampledFeedback:
    """Eq. 16: surfaces that give the destabilised aircraft the moments of the stable one, from stick and state."""
    have, s = derivatives_of(True, Cm_alpha), regressors(model)
    lack = {name: STABLE[name] - have[name] for name in have}
    elevator = (lack["Cm_alpha"] * s["alpha"] + lack["Cm_q"] * s["q"]) / have["Cm_delta_e"]
    effectiveness = np.array([[have[f"{c}_{d}"] for d in ("delta_a", "delta_r")] for c in ("Cl", "Cn")])
    moments = ca.vertcat(
        lack["Cl_beta"] * s["beta"] + lack["Cl_p"] * s["p"], lack["Cn_beta"] * s["beta"] + lack["Cn_r"] * s["r"]
    )
    aileron, rudder = ca.vertsplit(ca.DM(np.linalg.inv(effectiveness)) @ moments)
    received = ca.SX(model.u)
    for name, added in zip(SURFACES, (elevator, aileron, rudder), strict=True):
        received[model.inputs.index(name)] += added
    return SampledFeedback(model=model, received=received)


@dataclass(frozen=True, eq=False, kw_only=True)
class Truth:
    """Closed-loop simulation of one variant: step (x, u0, u1, dt, p) and signals (x, stick) -> surfaces, coefficients
    and contributions in the order of the names."""

    model: Model
    step: ca.Function
    signals: ca.Function


@cache
def truth(variant: int, destabilised: bool, Cm_alpha: float = CM_ALPHA_DESTABILISED) -> Truth:
    """The simulated aircraft with its nonlinear terms and, when destabilised, its control law."""
    derivatives = derivatives_of(destabilised, Cm_alpha)
    plain = aircraft_model(do328(derivatives), outputs=OUTPUTS, effects=())
    s, at_trim = regressors(plain), trim_point()
    law = control_law(plain, Cm_alpha) if destabilised else None
    received = law.received if law else plain.u
    inputs_at_trim = ca.DM([at_trim.inputs[name] for name in plain.inputs])
    elevator = ca.Function("trim", [plain.x, plain.u], [received])(at_trim.state, inputs_at_trim)[0]
    about = s | {"alpha": s["alpha"] - at_trim.alpha, "delta_e": s["delta_e"] - float(elevator)}
    extra = increments(variant, about, derivatives)
    w = ca.SX.zeros(len(plain.disturbances))
    for name, expression in extra.items():
        w[plain.disturbances.index(f"d{name.split('_')[0]}")] += expression
    model = replace(
        plain,
        f=ca.substitute(plain.f, plain.w, w),
        h=ca.substitute(plain.h, plain.w, w),
        w=ca.SX.sym("w", 0),
        disturbances=(),
    )
    own = None if law is None else SampledFeedback(model=model, received=law.received)
    terms = {n: derivatives[n] * (1.0 if n.endswith("_0") else s[n.split("_", 1)[1]]) for n in MOMENT_DERIVATIVES}
    terms = {name: term + extra.get(name, 0.0) for name, term in terms.items()}
    sums = [sum(t for n, t in terms.items() if n.startswith(c)) for c in COEFFICIENTS]
    flown = ca.vertcat(*[s[name] for name in SURFACES], *sums, *[terms[n] for n in MOMENT_DERIVATIVES])
    signals = ca.Function("signals", [plain.x, plain.u], [ca.substitute(flown, plain.u, received)])
    return Truth(model=model, step=step_function(model, own), signals=signals)


def fly(condition: Condition, Cm_alpha: float = CM_ALPHA_DESTABILISED, sticks: np.ndarray | None = None) -> Flight:
    """Simulate and measure one record; the same condition gives the same numbers.

    sticks (N, 3) at `sample_times`, about trim, instead of those of the condition's manoeuvre.
    """
    case = CASES[condition.case]
    flown = truth(condition.variant, case.destabilised, Cm_alpha)
    t, at_trim = sample_times(), trim_point()
    n = len(t)
    commands = np.tile([at_trim.inputs[name] for name in flown.model.inputs], (n, 1))
    commands[:, [flown.model.inputs.index(name) for name in SURFACES]] += (
        stick(condition.manoeuvre, t) if sticks is None else sticks
    )
    p = flown.model.nominal_vector()
    chain = flown.step.mapaccum("chain", n - 1)
    after = chain(at_trim.state, commands[:-1].T, commands[:-1].T, np.diff(t)[None], np.tile(p[:, None], n - 1))
    states = np.vstack([at_trim.state, after.full().T])
    if not np.isfinite(states).all():
        raise InputError(f"{condition.name}: the simulated aircraft itself departs; choose smaller nonlinear terms")
    found = flown.signals.map(n)(states.T, commands.T).full().T
    seen = regressors(flown.model)
    air = ca.Function("air", [flown.model.x], [ca.vertcat(*[seen[name] for name in ("V", "alpha", "beta")])])
    V, alpha, beta = air.map(n)(states.T).full()
    names = dict(zip(flown.model.states, states.T, strict=True))
    signals = {"V": V, "alpha": alpha, "beta": beta} | {r: names[r] for r in "pqr"}
    signals |= dict(zip((*SURFACES, *COEFFICIENTS), found.T, strict=False))
    commanded = {name: commands[:, flown.model.inputs.index(name)] for name in SURFACES}
    constant = {name: np.full(n, at_trim.inputs[name]) for name in ("thrust", "rho")}
    noise = _noise(signals, condition) if case.noisy else {name: np.zeros(n) for name in NOISE}
    measured = {name: values + noise[name] for name, values in signals.items()} | constant
    measured |= _attitude(t, measured, at_trim.theta) | {f"surface_{name}": measured[name] for name in SURFACES}

    def record(channels: dict[str, np.ndarray]) -> Record:
        return Record(name=condition.name, t=t, channels=channels, hold="held", source="simulated")

    return Flight(
        condition=condition,
        surfaces=record(measured),
        commands=record(measured | {name: values + noise[name] for name, values in commanded.items()}),
        exact=record(signals | constant | {f"stick_{name}": values for name, values in commanded.items()}),
        states=states,
        coefficients={c: signals[c] for c in COEFFICIENTS},
        contributions=dict(zip(MOMENT_DERIVATIVES, found.T[len(SURFACES) + len(COEFFICIENTS) :], strict=True)),
        derivatives=derivatives_of(case.destabilised, Cm_alpha),
    )


def _noise(signals: Mapping[str, np.ndarray], condition: Condition) -> dict[str, np.ndarray]:
    """White noise of Table 4; a seed of its own for every record."""
    key = (condition.seed, list(CASES).index(condition.case), condition.manoeuvre, condition.variant)
    rng = np.random.default_rng(key)
    return {name: rng.standard_normal(len(signals[name])) * sigma for name, sigma in noise_sigma(signals).items()}


def noise_sigma(signals: Mapping[str, np.ndarray] | Record) -> dict[str, float]:
    """Channel -> 1-sigma of Table 4's noise on true signals, SI."""
    sigmas = {}
    for name, relative in NOISE.items():
        values = signals[name]
        size = np.abs(values).max() if name == "V" else np.abs(values - values[0]).max()
        sigmas[name] = float(relative * size / SIGMAS_PER_AMPLITUDE)
    return sigmas


def _attitude(t: np.ndarray, measured: Mapping[str, np.ndarray], theta: float) -> dict[str, np.ndarray]:
    """Bank and pitch angle from the measured rates, from level trim on: attitude is not among the paper's signals."""
    angles = np.zeros((len(t), 2))
    angles[0, 1] = theta
    rates = np.stack([measured[name] for name in "pqr"], axis=1)
    for k, dt in enumerate(np.diff(t)):
        p, q, r = 0.5 * (rates[k] + rates[k + 1])
        phi, pitch = angles[k]
        turn = q * np.sin(phi) + r * np.cos(phi)
        angles[k + 1] = phi + dt * (p + turn * np.tan(pitch)), pitch + dt * (q * np.cos(phi) - r * np.sin(phi))
    return {"phi": angles[:, 0], "theta": angles[:, 1]}
