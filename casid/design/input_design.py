"""Design the most informative input within given limits: D- or A-optimal, by IPOPT on exact derivatives.

The bound is that of output error with the initial state free: states and their sensitivities to (initial state,
parameters) are integrated together, M = sum (dy/dtheta)' R^-1 (dy/dtheta). The initial state, which no more is
known of, is eliminated by the Schur complement. Parameters are in units of their size, so that "D" minimises the mean
logarithm of their relative variances and "A" their mean (Mulder, Sridhar and Breeman, AGARD AG-300 Vol. 3; Morelli and
Klein, 1990).

Limits hold at every sample. Every start takes a few steps of limited-memory BFGS, and the best of them goes on. BFGS is
cheap but knows only curvature upwards and creeps along the limits at the end, where the exact Hessian takes over.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from casid.arguments import one_of, require, whole
from casid.design.experiment import Experiment
from casid.design.input_shapes import Multisine, Shape, StepInput
from casid.errors import EstimationError
from casid.estimation.transcriptions.steps import output_function, step_function
from casid.native.threads import single_threaded
from casid.records.record import Record

_STEPS = StepInput()
_UNITS_S = np.geomspace(0.2, 3.0, 16)  # units of the standard 3-2-1-1 tried
_FIRST_ITERATIONS = 24  # by BFGS from each start, of which the best goes on; after 12 the order still changes
_COARSE = 3  # samples from one that is taken in these first steps to the next, at most
_PER_CYCLE = 10  # samples in a cycle of the fastest sine, at least
# by BFGS from the best of these; with the exact Hessian from its end
_ITERATIONS = 150
_EXACT_ITERATIONS = 300
_MOST_EXACT = 20  # unknowns for which exact Hessians are made: one of 32 takes a second, as 65 steps of BFGS do
_TOLERANCE = 1e-5  # of IPOPT's optimality conditions; the criterion is a logarithm
_STANDS = 1e-5  # relative change of the criterion by a step of BFGS that counts as none
_MEMORY = 20  # steps that BFGS remembers
_NEAR = 1e-6  # of a limit: how near to it a solver goes on where another stopped
_PUSHES = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac", "mult_bound_push")
_WARM = {"acceptable_iter": 0, "warm_start_init_point": "yes", "mu_init": 1e-4} | {
    f"warm_start_{name}": _NEAR for name in _PUSHES
}
_SLACK = 1e-3  # of a limit: what a solution may exceed it by
_LOOSE = 1e-6  # of the information of readings on an initial state: that of its prior, where readings have none


@dataclass(frozen=True, eq=False, kw_only=True)
class InputDesign:
    """A designed input.

    Attributes
    ----------
    record
        Inputs and exact outputs, ready to be flown or simulated.
    std
        Parameter -> Cramer-Rao bound.
    cost
        The criterion: mean log variance ("D") or log mean variance ("A") of the parameters over their sizes.
    unknowns
        Surface -> vector of its shape (see `StepInput`, `Multisine`).
    status
        "optimal" where IPOPT's conditions hold to 1e-5, or in words why not; "given" for a standard input.

    Examples
    --------
    After the example of `standard_3211`:

    >>> list(design.std), len(design.record)
    (['T'], 61)
    """

    record: Record
    std: Mapping[str, float]
    cost: float
    unknowns: Mapping[str, np.ndarray]
    status: str


@single_threaded()
def design_input(
    experiment: Experiment, shape: Shape = _STEPS, *, criterion: str = "D", starts: int = 4, seed: int = 0
) -> InputDesign:
    """The best input of a shape for every surface, from the best standard 3-2-1-1 and `starts` random ones.

    The optimum is local: that of the start which is best after its first steps.

    Parameters
    ----------
    experiment
        The model, what may move how far, what is measured, and which parameters count.
    shape
        `StepInput(...)` or `Multisine(...)`; default four pulses.
    criterion
        "D": mean log variance of the parameters over their sizes; "A": log of their mean variance.
    starts
        Number of random starts besides the standard input.
    seed
        Of the random starts.

    Returns
    -------
    InputDesign
        The record of the input with exact outputs, the Cramer-Rao bound of every parameter and the criterion.

    Raises
    ------
    InputError
        For a criterion other than "D" or "A" or a shape that does not fit.
    EstimationError
        When no start leads to an input within the limits.

    Examples
    --------
    After the example of `standard_3211`:

    >>> cs.design_input(experiment, cs.StepInput(pulses=4), starts=0).cost <= design.cost
    True
    """
    _check(experiment, shape, criterion)
    whole(starts, "design_input: starts", least=0)
    search = _InputSearch(experiment, shape, criterion)
    rng = np.random.default_rng(whole(seed, "design_input: seed", least=0))
    guesses = []
    if isinstance(shape, StepInput) and shape.pulses >= 4:
        guesses.append(_standard_unknowns(search, shape))
    random = ([shape.random(rng, experiment.duration) for _ in experiment.surfaces] for _ in range(starts))
    guesses += [np.concatenate(parts) for parts in random]
    begun = next(filter(None, map(search.begun, _by_first_steps(search, guesses))), None)
    if begun is None:
        raise EstimationError("design_input: no input within the limits was found; widen them, or try more starts")
    best = search.finished(begun)
    return search.design(best.z, best.status, "designed")


def standard_3211(experiment: Experiment, *, criterion: str = "D", rise_s: float = _STEPS.rise_s) -> InputDesign:
    """The best 3-2-1-1 with the same limits, for comparison.

    Surfaces move one after another. The unit of each is found by search, and its size is as large as the limits allow.

    Parameters
    ----------
    experiment
        As in `design_input`.
    criterion
        "D" or "A", as in `design_input`; it decides between units.
    rise_s
        What an edge takes, about [s].

    Returns
    -------
    InputDesign
        Its `status` is "given".

    Raises
    ------
    InputError
        For a criterion other than "D" or "A", and when the input does not fit into the record.

    Examples
    --------
    After the example of `Experiment`:

    >>> design = cs.standard_3211(experiment)
    >>> design.status, round(float(abs(design.record["u"]).max()), 1)
    ('given', 1.0)
    """
    shape = StepInput(rise_s=rise_s)
    _check(experiment, shape, criterion)
    search = _InputSearch(experiment, shape, criterion)
    return search.design(_standard_unknowns(search, shape), "given", "standard 3-2-1-1")


def _by_first_steps(search: _InputSearch, guesses: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Unknowns after the first steps from each guess, best first.

    These are taken at every few samples, as edges and sines allow: the order of the starts needs no more.
    """
    experiment = search.experiment
    shape = search.shape
    finest = shape.rise_s if isinstance(shape, StepInput) else experiment.duration / (_PER_CYCLE * shape.lines)
    every = min(int(finest / experiment.dt), _COARSE)
    if every > 1 and len(experiment.t) > 10 * every * every:
        search = _InputSearch(replace(experiment, dt=every * experiment.dt), shape, search.criterion)
    begun = [found for guess in guesses if (found := search.begun(guess)) is not None]
    return [found.z for found in sorted(begun, key=lambda found: search.cost(found.z))]


def _check(experiment: Experiment, shape: Shape, criterion: str) -> None:
    require(
        experiment, Experiment, "design_input: experiment", "cs.Experiment(model=..., surfaces={'delta_e': 0.05}, ...)"
    )
    require(shape, (StepInput, Multisine), "design_input: shape", "cs.StepInput(pulses=4) or cs.Multisine(lines=8)")
    one_of(criterion, ("D", "A"), "design_input: criterion")
    shape.check(experiment.duration)


def _standard_unknowns(search: _InputSearch, shape: StepInput) -> np.ndarray:
    """Unknowns of the best 3-2-1-1: surfaces follow each other, one unit for all, as large as the limits allow."""
    duration = search.experiment.duration
    count = len(search.experiment.surfaces)
    best = None
    least = math.inf
    for unit in _UNITS_S:
        if unit < shape.shortest_s or 0.5 + count * (7 * unit + 0.5) + shape.shortest_s * (shape.pulses - 4) > duration:
            continue
        parts = [shape.standard(unit, 1.0) for _ in range(count)]
        for i, part in enumerate(parts):
            part[0] += i * (7 * unit + 0.5)
        trial = search.within_limits(parts, shape)
        cost = search.cost(trial)
        if cost < least:
            best = trial
            least = cost
    if best is None:
        raise EstimationError(f"standard 3-2-1-1: none fits into {duration:g} s for {count} surfaces")
    return best


@dataclass(frozen=True, eq=False, kw_only=True)
class _Found:
    """End of IPOPT: unknowns, status, multipliers of the unknowns' limits and of the constraints."""

    z: np.ndarray
    status: str
    is_optimal: bool
    lam_x: np.ndarray
    lam_g: np.ndarray


class _InputSearch:
    """The problem of a design as CasADi functions of the vector of unknowns of all surfaces."""

    def __init__(self, experiment: Experiment, shape: Shape, criterion: str) -> None:
        self.experiment = experiment
        self.shape = shape
        self.criterion = criterion
        low, high = shape.bounds(experiment.duration)
        self.count = len(low)
        self.low, self.high = (np.tile(b, len(experiment.surfaces)) for b in (low, high))
        z = ca.MX.sym("z", len(self.low))
        moves = self._moves(z)
        information, paths = _integrated(experiment, ca.vertcat(*[m.T for m in moves.values()]))
        # in units in which readings at rest are equally informative about each initial state
        at_rest = np.diag(ca.Function("at_rest", [z], [information])(np.zeros(z.shape)).full())[: len(experiment.start)]
        told = np.where(at_rest > 0.0, at_rest, 1.0)
        information += ca.DM(np.diag(np.r_[_LOOSE * told, np.zeros(len(experiment.free))]))
        cost = _criterion(experiment, criterion)(information)
        ends = [shape.ends(part) / experiment.duration for part in self._parts(z) if isinstance(shape, StepInput)]
        over = [m / experiment.surfaces[n] for n, m in moves.items() if not isinstance(shape, StepInput)]
        self.g = ca.vertcat(*ends, *over, ca.vec(paths))
        self.g_low = np.r_[np.zeros(len(ends)), -np.ones(self.g.shape[0] - len(ends))]
        self._value = ca.Function("value", [z], [cost, information, self.g])
        self._nlp = {"x": z, "f": cost, "g": self.g}
        self._solvers: dict[str, ca.Function] = {}

    def _solver(self, name: str) -> ca.Function:
        if name not in self._solvers:
            bfgs = {"hessian_approximation": "limited-memory"}
            standing = {"acceptable_tol": 1e2, "acceptable_obj_change_tol": _STANDS, "acceptable_iter": 8}
            own = {
                "first steps": bfgs | {"max_iter": _FIRST_ITERATIONS},
                "BFGS": bfgs | {"max_iter": _ITERATIONS, "limited_memory_max_history": _MEMORY} | _WARM | standing,
                "exact": {"max_iter": _EXACT_ITERATIONS} | _WARM,
            }
            common = {"print_level": 0, "sb": "yes", "tol": _TOLERANCE}
            whole = {"print_time": False, "error_on_fail": False, "ipopt": common | own[name]}
            self._solvers[name] = ca.nlpsol("design", "ipopt", self._nlp, whole)
        return self._solvers[name]

    def _parts(self, z: Any) -> list[Any]:
        return [z[i * self.count : (i + 1) * self.count] for i in range(len(self.experiment.surfaces))]

    def _moves(self, z: Any) -> dict[str, Any]:
        limits = self.experiment.surfaces
        t = self.experiment.t
        return {n: limits[n] * self.shape.samples(p, t) for n, p in zip(limits, self._parts(z), strict=True)}

    def cost(self, z: np.ndarray) -> float:
        """The criterion; infinite for what departs or does not depend on a parameter."""
        value = float(self._value(z)[0])
        return value if math.isfinite(value) else math.inf

    def worst(self, z: np.ndarray) -> float:
        """Largest limited quantity over its limit; infinite for what departs."""
        beyond = np.abs(np.asarray(self._value(z)[2]))
        return float(beyond.max(initial=0.0)) if np.isfinite(beyond).all() else math.inf

    def within_limits(self, parts: list[np.ndarray], shape: StepInput) -> np.ndarray:
        """Steps with the sizes of each surface as large as the limits allow when it moves alone, then all of them by a
        common factor where they are too large together."""
        sizes = np.arange(self.count) > shape.pulses
        alone = []
        for i, part in enumerate(parts):
            still = [np.where(sizes, 0.0, p) for p in parts]
            own = np.concatenate([part if k == i else p for k, p in enumerate(still)])
            alone.append(np.where(sizes, self._largest(own, sizes) * part, part))
        together = np.concatenate(alone)
        factor = self._largest(together, sizes)
        return np.where(np.tile(sizes, len(parts)), factor * together, together)

    def _largest(self, z: np.ndarray, sizes: np.ndarray) -> float:
        """Largest factor, up to 1, on the sizes in z that keeps all limits, by bisection."""
        if self.worst(z) <= 1.0 + 1e-9:
            return 1.0
        low = 0.0
        high = 1.0
        scaled = np.tile(sizes, len(z) // self.count)
        for _ in range(12):
            middle = 0.5 * (low + high)
            inside = self.worst(np.where(scaled, middle * z, z)) <= 1.0
            low, high = (middle, high) if inside else (low, middle)
        return low

    def begun(self, guess: np.ndarray) -> _Found | None:
        """Take the first steps of BFGS from a guess; None when they end outside the limits."""
        return self._run("first steps", x0=np.clip(guess, self.low, self.high))

    def finished(self, found: _Found) -> _Found:
        """Go on by BFGS, and with the exact Hessian from where that stops, unless it stops at an optimum."""
        for solver in ("BFGS", "exact"):
            if found.is_optimal or (solver == "exact" and len(self.low) > _MOST_EXACT):
                break
            further = self._run(solver, x0=found.z, lam_x0=found.lam_x, lam_g0=found.lam_g)
            if further is not None and self.cost(further.z) <= self.cost(found.z) + further.is_optimal * _SLACK:
                found = further
        return found

    def _run(self, name: str, **start: np.ndarray) -> _Found | None:
        solver = self._solver(name)
        result = solver(**start, lbx=self.low, ubx=self.high, lbg=self.g_low, ubg=1.0)
        z, lam_x, lam_g = (np.asarray(result[name]).ravel() for name in ("x", "lam_x", "lam_g"))
        if not np.isfinite(z).all() or self.worst(z) > 1.0 + _SLACK or not math.isfinite(self.cost(z)):
            return None
        said = str(solver.stats()["return_status"])
        is_optimal = said == "Solve_Succeeded"
        status = "optimal" if is_optimal else f"stopped: {said}"
        return _Found(z=z, status=status, is_optimal=is_optimal, lam_x=lam_x, lam_g=lam_g)

    def design(self, z: np.ndarray, status: str, name: str) -> InputDesign:
        experiment = self.experiment
        cost, information, _ = self._value(z)
        variances = np.diagonal(np.linalg.inv(np.asarray(information)))  # of initial states, then of parameters
        std = np.sqrt(variances[len(experiment.start) :]) * experiment.sizes
        moves = {n: np.asarray(m).ravel() for n, m in self._moves(z).items()}
        return InputDesign(
            record=experiment.record(moves, name),
            std=dict(zip(experiment.free, std.tolist(), strict=True)),
            cost=float(cost),
            unknowns=dict(zip(experiment.surfaces, self._parts(z), strict=True)),
            status=status,
        )


def _integrated(experiment: Experiment, moves: ca.MX) -> tuple[ca.MX, ca.MX]:
    """Return the information (n+f, n+f) of initial state and of parameters over their sizes, and the limited
    quantities (limits, N) over their limits, of deflections `moves` (surfaces, N)."""
    model = experiment.model
    n = len(model.states)
    f = len(experiment.free)
    count = len(experiment.t)
    p = model.nominal_vector(experiment.values)
    rest = np.array([experiment.rest[name] for name in model.inputs])
    place = np.zeros((len(rest), len(experiment.surfaces)))
    for k, name in enumerate(experiment.surfaces):
        place[model.inputs.index(name), k] = 1.0
    inputs = np.repeat(rest[:, None], count, axis=1) + ca.mtimes(ca.DM(place), moves)
    following = ca.horzcat(inputs[:, 1:], inputs[:, -1])
    steps = np.r_[np.full(count - 1, experiment.dt), 0.0][None]
    informed, limited = _advance(experiment, p)
    z0 = ca.vertcat(experiment.start, ca.vec(ca.DM(np.eye(n, n + f))))
    _, gained = informed.mapaccum("information", count)(z0, inputs, following, steps)
    # a chain of its own: derivatives of the limits at every sample do not go through the sensitivities
    _, paths = limited.mapaccum("limits", count)(experiment.start, inputs, following, steps)
    return ca.tril2symm(ca.MX(ca.Sparsity.lower(n + f), ca.sum2(gained))), paths


def _advance(experiment: Experiment, p: np.ndarray) -> tuple[ca.Function, ca.Function]:
    """([x; sensitivities], u0, u1, dt) -> the same after the step, information of the sample (its lower triangle by
    columns); and (x, u0, u1, dt) -> x after the step, limited quantities."""
    model = experiment.model
    n = len(model.states)
    f = len(experiment.free)
    step = step_function(model)
    output = output_function(model)
    symbols = [ca.SX.sym(name, *step.size_in(i)) for i, name in enumerate(("x", "u0", "u1", "dt", "p"))]
    x, u0, u1, dt, q = symbols
    free = [model.parameters.index(name) for name in experiment.free]
    after = step(*symbols)
    y = output(x, u0, q)
    size = ca.DM(np.diag(experiment.sizes))
    a = ca.jacobian(after, x)
    b = ca.jacobian(after, q)[:, free] @ size
    c = ca.jacobian(y, x)
    d = ca.jacobian(y, q)[:, free] @ size
    s = ca.SX.sym("s", n, n + f)
    following = a @ s + ca.horzcat(ca.SX.zeros(n, n), b)
    weight = np.array([1.0 / experiment.noise[o] if o in experiment.noise else 0.0 for o in model.outputs])
    rows = ca.diag(ca.DM(weight)) @ (c @ s + ca.horzcat(ca.SX.zeros(len(weight), n), d))
    gained = rows.T @ rows
    lower = ca.vertcat(*[gained[i, j] for j in range(n + f) for i in range(j, n + f)])
    both = ca.vertcat(x, y)
    names = (*model.states, *model.outputs)
    rest = [experiment.rest[name] for name in model.inputs]
    moved = both - ca.Function("rest", [x, u0, q], [both])(experiment.start, rest, p)
    limited = [moved[names.index(k)] / limit for k, limit in experiment.limits.items()]
    limits = ca.vertcat(*limited) if limited else ca.SX(0, 1)
    results = [ca.vertcat(after, ca.vec(following)), lower, after, limits]
    results = ca.substitute([ca.densify(r) for r in results], [q], [ca.SX(ca.DM(p))])
    return (
        ca.Function("informed", [ca.vertcat(x, ca.vec(s)), u0, u1, dt], ca.cse(results[:2])),
        ca.Function("limited", [x, u0, u1, dt], ca.cse(results[2:])),
    )


def _criterion(experiment: Experiment, criterion: str) -> ca.Function:
    """(n+f, n+f) information -> the cost of the parameters with the initial state eliminated."""
    n = len(experiment.model.states)
    f = len(experiment.free)
    m = ca.SX.sym("m", n + f, n + f)
    # ordered (initial state, parameters), the lower right block of the Cholesky factor is that of the Schur complement
    root = ca.chol(0.5 * (m + m.T))[n:, n:]
    if criterion == "D":
        cost = -2.0 / f * ca.sum1(ca.log(ca.diag(root)))
    else:
        cost = ca.log(ca.sumsqr(ca.solve(root, ca.SX.eye(f))) / f)
    return ca.Function("criterion", [m], [cost])
