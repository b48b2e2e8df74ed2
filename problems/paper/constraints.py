"""What is known beforehand, said as a constraint: it rescues an estimate from a record that excites too little.

The poor record is a slow, small pitch input: angle of attack follows the elevator and the pitch rate stays near zero,
so Cm_alpha, Cm_delta_e and Cm_q can hardly be told apart. The good record is the paper's first manoeuvre.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType

import numpy as np

from casid.errors import unknown
from casid.estimation import (
    Fit,
    GaussNewton,
    InitialState,
    Ipopt,
    MultipleShooting,
    OutputError,
    Problem,
    limit_combination,
    limit_parameter,
    limit_trajectory,
    solve,
)
from casid.estimation.constraints import Constraint, LinearConstraint, PathConstraint
from casid.records.record import Record
from problems.do328 import STABLE
from problems.manoeuvres import Part, sample_times
from problems.paper.cases import Condition
from problems.paper.estimation import INITIAL_STD, INTERVAL, START_FACTOR, estimation_model
from problems.paper.truth import OUTPUTS, Flight, fly, noise_sigma, trim_point

PITCH = ("Cm_0", "Cm_alpha", "Cm_delta_e", "Cm_q")
ROLL = ("Cl_p", "Cl_r", "Cl_beta", "Cl_delta_a")
STATIC_MARGIN = -STABLE["Cm_alpha"] / STABLE["CL_alpha"]  # of the mean chord
ALPHA_LIMIT = 0.00858  # rad: known never to be exceeded in the poor record, whose truth reaches 0.00857860
SOLVERS = MappingProxyType({"Gauss-Newton": GaussNewton(), "IPOPT": Ipopt(hessian="gauss-newton")})


@cache
def flight(name: str) -> Flight:
    """The poor or the good record."""
    if name == "good":
        return fly(Condition(case="B", manoeuvre=1, seed=1))
    sticks = np.zeros((len(sample_times()), 3))
    sticks[:, 0] = Part("pitch", "sine", 1, 18, 0.003, 2).at(sample_times())
    sticks[:, 1] = Part("roll", "boxcar", 8, 2, 0.001, 1).at(sample_times())
    return fly(Condition(case="A", manoeuvre=1), sticks=sticks)


def noise() -> dict[str, float]:
    """1-sigma of the instruments, which do not know how much a record excites: that of the good one for both."""
    return noise_sigma(flight("good").exact)


@cache
def record(name: str) -> Record:
    """The measured record."""
    flown = flight(name).surfaces
    if name == "poor":
        rng = np.random.default_rng(2)
        noisy = {n: flown[n] + rng.standard_normal(len(flown)) * s for n, s in noise().items()}
        flown = flown.with_channels(**noisy)
    return replace(flown, name=name)


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """What is constrained, in words; `free` parameters, with an own value in each of `records` when `per_record`."""

    words: str
    constraints: tuple[Constraint, ...]
    free: tuple[str, ...] = PITCH
    records: tuple[str, ...] = ("poor",)
    per_record: bool = False


@cache
def experiments() -> Mapping[str, Experiment]:
    """Every constraint in a line or two."""
    at = trim_point()
    tied = tuple(
        limit_combination({f"{n}[poor]": 1.0, f"{n}[good]": -1.0}, lower=0.0, upper=0.0) for n in ("Cm_alpha", "Cm_q")
    )
    return MappingProxyType(
        {
            "none": Experiment(words="nothing is known", constraints=()),
            "none, roll": Experiment(words="nothing is known, roll derivatives", constraints=(), free=ROLL),
            "bounds": Experiment(
                words="damping within 30 % of a handbook value",
                constraints=(limit_parameter("Cm_q", lower=-34.0, upper=-18.0),),
            ),
            "signs": Experiment(
                words="roll is damped, dihedral effect positive, yawing to the right rolls to the right",
                free=ROLL,
                constraints=(
                    limit_parameter("Cl_p", upper=0.0),
                    limit_parameter("Cl_beta", upper=0.0),
                    limit_parameter("Cl_r", lower=0.0),
                ),
            ),
            "static margin": Experiment(
                words=f"static margin {STATIC_MARGIN:.3f} from a wind tunnel: Cm_alpha = - margin * CL_alpha",
                constraints=(limit_combination({"Cm_alpha": 1.0}, lower=STABLE["Cm_alpha"], upper=STABLE["Cm_alpha"]),),
            ),
            "trim moment": Experiment(
                words="the moments balance in the known trim: Cm_0 + Cm_alpha alpha + Cm_delta_e delta_e = 0",
                constraints=(
                    limit_combination(
                        {"Cm_0": 1.0, "Cm_alpha": at.alpha, "Cm_delta_e": at.delta_e}, lower=0.0, upper=0.0
                    ),
                ),
            ),
            "path": Experiment(
                words=f"angle of attack stayed below {ALPHA_LIMIT} rad",
                constraints=(limit_trajectory("alpha", upper=ALPHA_LIMIT),),
            ),
            "tied": Experiment(
                words="own values in each record, but Cm_alpha and Cm_q are those of the good record too",
                constraints=tied,
                records=("poor", "good"),
                per_record=True,
            ),
        }
    )


def problem(name: str, shift: float = 0.0, only: int = 0) -> Problem:
    """The problem of an experiment. shift: the limits of its constraint number `only` moved by this much.

    Raises InputError for an experiment that does not exist.
    """
    if name not in experiments():
        raise unknown("experiment", name, experiments())
    chosen = experiments()[name]
    constraints = [_moved(c, shift if i == only else 0.0) for i, c in enumerate(chosen.constraints)]
    return Problem(
        estimation_model(),
        [record(r) for r in chosen.records],
        free=[] if chosen.per_record else chosen.free,
        per_record=chosen.free if chosen.per_record else [],
        start={n: START_FACTOR * STABLE[n] for n in chosen.free},
        cost=OutputError(),
        noise={output: noise()[output] for output in OUTPUTS},
        constraints=constraints,
        initial_state=InitialState(std=INITIAL_STD),
    )


def _moved(constraint: Constraint, shift: float) -> Constraint:
    if not isinstance(constraint, LinearConstraint):
        return constraint
    return replace(constraint, lower=constraint.lower + shift, upper=constraint.upper + shift)


def estimate(name: str, solver: str = "Gauss-Newton", shift: float = 0.0, only: int = 0) -> Fit:
    """Solve an experiment."""
    return solve(problem(name, shift, only), MultipleShooting(interval=INTERVAL), SOLVERS[solver])


def limit_words(name: str, number: int) -> str:
    """A constraint in a line: -34 <= Cm_q <= -18."""
    constraint = experiments()[name].constraints[number]
    if isinstance(constraint, LinearConstraint):
        middle = " + ".join(n if c == 1.0 else f"{c:.4g} {n}" for n, c in constraint.coefficients.items())
    else:
        middle = constraint.name if isinstance(constraint, PathConstraint) else "function"
    return f"{constraint.lower:.4g} <= {middle} <= {constraint.upper:.4g}"


def truth_of(name: str) -> float:
    """True value of an estimate, whatever record it belongs to."""
    return STABLE[name.split("[")[0]]


def worst_error(fit: Fit) -> float:
    """Largest relative error of the estimates from the poor record, offsets left out."""
    names = {n: n.removesuffix("[poor]") for n in fit.values if not n.endswith("[good]")}
    return max(abs(fit[name].value / STABLE[bare] - 1.0) for name, bare in names.items() if not bare.endswith("_0"))
