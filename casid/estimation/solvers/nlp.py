"""The problem as a nonlinear programme for a general solver: every cost, transcription and constraint.

Variables, scaled: parameters, nodes, noise of soft defects, interior states of collocation. All data, weights and
fixed values are parameters of the programme, so that one programme serves every data set of the same size.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import Levels, NoiseState, Point
from casid.estimation.solvers.separable import Separable
from casid.estimation.transcriptions.dynamics import ProblemSymbols, Simulated
from casid.estimation.transcriptions.equation import EquationPart
from casid.estimation.transcriptions.symbolic import SampleSymbols, with_data

_Bounded = tuple[ca.MX, float | np.ndarray, float | np.ndarray]


@dataclass(frozen=True, eq=False, kw_only=True)
class Programme:
    """nlp: x, p, f, g for casadi.nlpsol; residual, the vector of which f is half the sum of squares times a gain;
    lower, upper of g; linear (slice of g with the linear constraints).
    separable is what derivatives by segment take, None where there are none."""

    x: ca.MX
    p: ca.MX
    gain: ca.MX
    residual: ca.MX
    f: ca.MX
    g: ca.MX
    lower: np.ndarray
    upper: np.ndarray
    linear: slice
    separable: Separable | None


class Packing:
    """Symbols of one vector and the numbers that go there, by name and in one order."""

    def __init__(self, values: dict[str, np.ndarray]) -> None:
        self.symbols = {name: ca.MX.sym(name, *np.atleast_2d(v).shape) for name, v in values.items()}

    @property
    def vector(self) -> ca.MX:
        """All symbols, column-major, one after the other."""
        return ca.vertcat(*[ca.vec(s) for s in self.symbols.values()])

    def pack(self, values: dict[str, np.ndarray]) -> np.ndarray:
        """Numbers in the same order."""
        return np.concatenate([np.atleast_2d(values[name]).ravel(order="F") for name in self.symbols])

    def unpack(self, vector: np.ndarray) -> dict[str, np.ndarray]:
        """Arrays by name, from the numbers."""
        out = {}
        at = 0
        for name, symbol in self.symbols.items():
            out[name] = vector[at : at + symbol.numel()].reshape(symbol.shape, order="F")
            at += symbol.numel()
        return out


def is_programmable(objective: Objective) -> bool:
    """Return True if the residuals have a form as expressions, which those of a cost with own equations do not have."""
    return objective.equations is None or isinstance(objective.equations, EquationPart)


def variables(objective: Objective, point: Point, scale: np.ndarray) -> dict[str, np.ndarray]:
    """Scaled variables at a point; time runs along the columns."""
    found = {"theta": (point.theta / scale)[:, None]}
    if objective.dynamics is not None:
        found["nodes"] = (point.nodes / objective.scale).T
        if objective.soft:
            found["noise"] = point.noise.T
        if objective.paths is not None and objective.paths.soft.any():
            found["excess"] = objective.paths.soft_excess(objective.value(point))
        if point.points is not None:
            found["points"] = (point.points / objective.scale).reshape(-1, len(objective.scale)).T
    return found


def point_from(objective: Objective, values: dict[str, np.ndarray], scale: np.ndarray, like: Point) -> Point:
    """The inverse of `variables`."""
    theta = values["theta"][:, 0] * scale
    if objective.dynamics is None:
        return Point(theta=theta, nodes=like.nodes, noise=like.noise)
    nodes = values["nodes"].T * objective.scale
    noise = values["noise"].T.copy() if "noise" in values else like.noise
    points = None
    if like.points is not None:
        points = (values["points"].T.reshape(like.points.shape)) * objective.scale
    return Point(theta=theta, nodes=nodes, noise=noise, points=points)


def data(objective: Objective, noise: NoiseState, scale: np.ndarray, gain: float) -> dict[str, np.ndarray]:
    """Everything that differs between two problems of the same size, weighed with `noise`; `gain` multiplies the
    cost."""
    problem = objective.problem
    base = problem.model_parameters(np.zeros_like(scale))
    values = {"gain": np.array([[gain]]), "base": base.T, "scale": scale[:, None], "nominal": problem.nominal[:, None]}
    values["precision"] = (1.0 / problem.prior_std)[:, None]
    if objective.dynamics is not None:
        layout = objective.layout
        flat = {k: getattr(layout, k) for k in ("u0", "u1", "z")}
        values |= {k: v.reshape(layout.dt.size, v.shape[2]).T for k, v in flat.items()}
        values |= {"dt": layout.dt.reshape(1, -1)} | _weights(objective, noise.levels)
        values |= {"centre": objective.centre.T, "initial_precision": objective.initial_precision.T}
        if noise.factor is not None:
            values["factor"] = noise.factor.transpose(1, 0, 2).reshape(len(objective.scale), -1)
    if isinstance(objective.equations, EquationPart):
        measured = np.concatenate(objective.equations.data)
        residual = np.concatenate(objective.equations.value(problem.start_parameters).residuals)
        # a missing signal takes no part, but must be a number
        values["signals"] = np.where(np.isfinite(measured), measured, np.nanmean(measured, axis=0)).T
        values["seen"] = np.isfinite(residual).astype(float).T
        values["equation_weights"] = objective.equation_weights(noise.levels)[:, None]
    return values


def _weights(objective: Objective, levels: Levels) -> dict[str, np.ndarray]:
    """A factor for every measurement; with a full covariance the triangle of each pattern and which samples have it."""
    pattern = objective.layout.pattern.ravel()
    weights = objective.whitening(levels)
    if not levels.full:
        return {"weights": np.diagonal(weights, axis1=1, axis2=2)[pattern].T}
    which = pattern == np.arange(len(weights))[:, None]
    return {"triangles": np.hstack(list(weights)), "which": which.astype(float)}


def _whitened(difference: ca.MX, s: dict) -> ca.MX:
    if "weights" in s:
        return s["weights"] * difference
    o = difference.shape[0]
    count = s["which"].shape[0]
    triangles = ca.horzsplit(s["triangles"], o)
    parts = [(triangles[k] @ difference) * ca.repmat(s["which"][k, :], o, 1) for k in range(count)]
    return sum(parts[1:], parts[0])


def build(objective: Objective, x: Packing, d: Packing) -> Programme:
    """The programme in the symbols of `x` (variables) and `d` (data)."""
    v = x.symbols
    s = d.symbols
    arguments = _arguments(objective, v, s) if objective.dynamics is not None else None
    motion = objective.dynamics.symbolic(arguments) if objective.dynamics is not None and arguments else None
    residual, constraints = _posed(objective, v, s, motion)
    paid = _paid(objective, v)
    lower = np.concatenate([np.broadcast_to(low, (g.numel(),)) for g, low, _ in constraints])
    upper = np.concatenate([np.broadcast_to(up, (g.numel(),)) for g, _, up in constraints])
    linear = slice(len(lower) - len(objective.limits), len(lower))
    separable = None
    by_segment = "weights" in s and not objective.problem.path_constraints
    if by_segment and motion is not None and motion.derivatives is not None and arguments is not None:
        separable = _separable(objective, v, s, motion, arguments)
    return Programme(
        x=x.vector,
        p=d.vector,
        gain=s["gain"],
        residual=residual,
        f=s["gain"] * (0.5 * ca.sumsqr(residual) + paid),
        g=ca.vertcat(*[g for g, _, _ in constraints]),
        lower=lower,
        upper=upper,
        linear=linear,
        separable=separable,
    )


def _free(objective: Objective, v: dict, s: dict) -> list[ca.MX]:
    """Free parameters of each record."""
    problem = objective.problem
    theta = v["theta"] * s["scale"]
    return [theta[[int(i) for i in problem.columns(r)]] for r in range(len(problem.records))]


def _sizes(objective: Objective, count: int) -> ca.DM:
    """(n, count) typical size of the states."""
    return ca.repmat(ca.DM(objective.scale), 1, count)


def _states(objective: Objective, scaled: ca.MX) -> ca.MX:
    """States (n, any) from scaled ones."""
    return scaled * _sizes(objective, scaled.shape[1])


def _arguments(objective: Objective, v: dict, s: dict) -> ProblemSymbols:
    records = [int(r) for r in objective.layout.record]
    free = _free(objective, v, s)
    return ProblemSymbols(
        nodes=_states(objective, v["nodes"]),
        points=_states(objective, v["points"]) if "points" in v else None,
        base=s["base"][:, records],
        free=ca.horzcat(*[free[r] for r in records]),
        **{name: s[name] for name in ("u0", "u1", "dt")},
    )


def _posed(objective: Objective, v: dict, s: dict, motion: Simulated | None) -> tuple[ca.MX, list[_Bounded]]:
    """The residual and the constraints, each with its bounds."""
    theta = v["theta"] * s["scale"]
    residuals = [(theta - s["nominal"]) * s["precision"]]
    constraints: list[_Bounded] = []
    if motion is not None:
        nodes = _states(objective, v["nodes"])
        first = [int(i) for i in objective.layout.first]
        start = nodes[:, first] - s["centre"]
        residuals.append(ca.vec(start * s["initial_precision"]))
        held = [int(i) for i in np.flatnonzero(objective.exact.T.ravel(order="F"))]
        if held:
            constraints.append((ca.vec(start / _sizes(objective, len(first)))[held], 0.0, 0.0))
        residuals.append(ca.vec(_whitened(motion.y - s["z"], s)))
        defect = _defects(objective, nodes, motion.end, v, s)
        if "noise" in v:
            residuals.append(ca.vec(v["noise"]))
        constraints += [(defect, 0.0, 0.0), (motion.gap, 0.0, 0.0)]
        constraints += _paths(objective, v, motion.states, motion.y)
    if isinstance(objective.equations, EquationPart):
        residuals.append(_equations(objective, objective.equations, _free(objective, v, s), s))
    constraints.append((objective.limits.symbolic(theta), objective.limits.lower, objective.limits.upper))
    return ca.vertcat(*residuals), constraints


def _separable(objective: Objective, v: dict, s: dict, motion: Simulated, at: ProblemSymbols) -> Separable:
    """Build what the segments' own derivatives need; without path constraints nothing but end and outputs is
    simulated."""
    assert motion.derivatives is not None
    end = ca.MX.sym("end", *motion.end.shape)
    y = ca.MX.sym("y", *motion.y.shape)
    residual, constraints = _posed(objective, v, s, replace(motion, end=end, y=y))
    others = sum(symbol.numel() for name, symbol in v.items() if name not in ("theta", "nodes"))
    nodes = np.tile(objective.scale, v["nodes"].shape[1])
    return Separable(
        derivatives=motion.derivatives,
        arguments=[at.nodes, at.u0, at.u1, at.dt, at.base, at.free],
        simulated=(motion.end, motion.y),
        end=end,
        y=y,
        residual=residual,
        g=ca.vertcat(*[g for g, _, _ in constraints]),
        curvature=s["weights"] ** 2,
        scale=ca.vertcat(s["scale"], ca.DM(nodes), ca.DM.ones(others)),
    )


def _defects(objective: Objective, nodes: ca.MX, end: ca.MX, v: dict, s: dict) -> ca.MX:
    tied = [int(i) for i in objective.layout.tied]
    if not tied:
        return ca.MX(0, 1)
    defect = end[:, tied] - nodes[:, [i + 1 for i in tied]]
    if "noise" in v:
        n = len(objective.scale)
        factors = ca.horzsplit(s["factor"], n)
        defect = defect + ca.horzcat(*[factors[j] @ v["noise"][:, j] for j in range(len(tied))])
    return ca.vec(defect / _sizes(objective, len(tied)))


def _paths(objective: Objective, v: dict, states: ca.MX, y: ca.MX) -> list[_Bounded]:
    """Limits at the samples, in sizes of the quantities; where they are soft, an excess >= 0 is taken off."""
    problem = objective.problem
    paths = objective.paths
    samples = [int(i) for sample in objective.layout.sample for i in sample]
    found: list[_Bounded] = []
    for c, constraint in enumerate(problem.path_constraints):
        assert paths is not None
        names = problem.model.states
        values = states
        if constraint.name not in names:
            names = problem.model.outputs
            values = y
        size = float(paths.scale[c])
        signal = ca.vec(values[names.index(constraint.name), samples]) / size
        low = constraint.lower / size
        high = constraint.upper / size
        if not paths.soft[c]:
            found.append((signal, low, high))
            continue
        excess = v["excess"][:, int(paths.soft[:c].sum())]
        found += [(excess, 0.0, np.inf)]
        found += [(signal - excess, -np.inf, high)] if np.isfinite(high) else []
        found += [(signal + excess, low, np.inf)] if np.isfinite(low) else []
    return found


def _paid(objective: Objective, v: dict) -> ca.MX | float:
    """Return the cost of the excess over soft path limits."""
    if "excess" not in v or objective.paths is None:
        return 0.0
    paths = objective.paths
    price = (paths.price * paths.scale)[paths.soft]
    return ca.dot(ca.sum1(v["excess"]).T, ca.DM(price))


def _equations(objective: Objective, equations: EquationPart, free: list[ca.MX], s: dict) -> ca.MX:
    lengths = [len(record) for record in objective.problem.records]
    records = np.repeat(np.arange(len(lengths)), lengths).tolist()
    at = SampleSymbols(objective.problem.model, objective.problem.free_index)
    signals = ca.SX.sym("m", *equations.residual.size_in(0))
    residual = with_data("equation", [signals, at.base, at.q], [equations.residual(signals, at.p)], (2,))
    found = residual.map(sum(lengths))(s["signals"], s["base"][:, records], ca.horzcat(*free)[:, records])
    return ca.vec(s["seen"] * found * ca.repmat(s["equation_weights"], 1, sum(lengths)))
