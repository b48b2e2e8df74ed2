"""Signs of what moves, as in dry friction, made continuous: no step of integration resolves a motion that sticks.

sign(z) becomes tanh(z / e) with e a small part of the size of z. What sticks then creeps, and the motion has
derivatives. A solution with a large e is where the search with a smaller one begins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import casadi as ca
import numpy as np

from casid.estimation.problem import Problem
from casid.model.built import cached, share_cache
from casid.model.system import Model

_SHARES = (1e-2, 3e-3, 1e-3, 3e-4)  # of the size of an argument


def without_switching(problem: Problem) -> Iterator[tuple[Problem, str]]:
    """List the problem with signs of its states made continuous, each time over a smaller part of their size, as far as
    its motion is a differential equation, with remarks; itself where there are none."""
    model = problem.model
    arguments = None  # of all signs of the dynamics
    if problem.simulated and problem.feedback is None and model.period is None:
        arguments = cached(model, ("arguments of signs",), lambda: _arguments(model))
    sizes = np.zeros(1)
    if arguments is not None:
        found = np.abs(np.concatenate(problem.at_guess(arguments)))
        sizes = found.max(axis=0, where=np.isfinite(found), initial=0.0)
    if arguments is None or not (np.isfinite(sizes).all() and (sizes > 0.0).all()):
        yield problem, ""
        return
    rounded = 10.0 ** (0.5 * np.round(2.0 * np.log10(sizes)))  # the same for records alike
    for share in _SHARES:
        yield _smooth(problem, arguments, share * rounded)


def _smooth(problem: Problem, arguments: ca.SX, widths: np.ndarray) -> tuple[Problem, str]:
    model = problem.model
    smooth = cached(model, ("smooth", *widths), lambda: replace(model, f=_rebuilt(model, widths)))
    names = [str(z) for z in ca.vertsplit(arguments)]
    said = ", ".join(f"sign({z}) as tanh({z} / {width:.2g})" for z, width in zip(names, widths, strict=True))
    model = share_cache(replace(smooth, guess=model.guess), smooth)
    return replace(problem, model=model), f"integrated with {said}"


def _function(model: Model) -> ca.Function:
    return ca.Function("f", [model.x, model.u, model.p, model.w], [ca.densify(model.f)])


def _arguments(model: Model) -> ca.SX | None:
    """Arguments of all signs of the dynamics, a column; None where no sign depends on a state, or where an expression
    cannot be taken apart."""
    function = _function(model)
    kinds = {function.instruction_id(k) for k in range(function.n_instructions())}
    if ca.OP_SIGN not in kinds or ca.OP_CALL in kinds:
        return None
    found: list[ca.SX] = []
    _walked(function, model, lambda z: found.append(z) or z)
    column = ca.vertcat(*found)
    return column if all(ca.which_depends(column, model.x, 1, True)) else None


def _rebuilt(model: Model, widths: np.ndarray) -> ca.SX:
    following = iter(widths)
    return _walked(_function(model), model, lambda z: ca.tanh(z / next(following)))


def _walked(function: ca.Function, model: Model, sign: Callable[[ca.SX], ca.SX]) -> ca.SX:
    """Take the dynamics with `sign(z)` in the place of each sign."""
    given = [model.x, model.u, model.p, model.w]
    w = [ca.SX(0)] * function.sz_w()
    f = ca.SX(*function.size_out(0))
    for k in range(function.n_instructions()):
        kind = function.instruction_id(k)
        to = function.instruction_output(k)
        of = function.instruction_input(k)
        if kind == ca.OP_INPUT:
            w[to[0]] = given[of[0]][of[1]]
        elif kind == ca.OP_OUTPUT:
            f[to[1]] = w[of[0]]
        elif kind == ca.OP_CONST:
            w[to[0]] = ca.SX(function.instruction_constant(k))
        elif kind == ca.OP_SIGN:
            w[to[0]] = sign(w[of[0]])
        else:
            w[to[0]] = ca.SX.unary(kind, w[of[0]]) if len(of) == 1 else ca.SX.binary(kind, w[of[0]], w[of[1]])
    return f
