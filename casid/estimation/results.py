"""How a solution ended, and for what reason: a state, a parameter, a time or an expression is named."""

from __future__ import annotations

from enum import Enum
from typing import Any

import casadi as ca
import numpy as np

from casid.estimation.problem import Problem
from casid.estimation.solvers.full_noise import FullNoise
from casid.estimation.solvers.newton import FLAT_MINIMUM
from casid.estimation.solvers.point import Point
from casid.estimation.uncertainty import Uncertainty
from casid.model.expressions import origin
from casid.model.system import unguessed_states

ANOTHER_MINIMUM = "another minimum likely"


class Results(Enum):
    """How a solution ended. The value of each is a sentence that says what to do; `Fit.status` has the particulars.

    Examples
    --------
    >>> import numpy as np, casid as cs
    >>> lag = cs.define_model(
    ...     "lag", states=["x"], inputs=["u"], parameters={"T": 0.5}, outputs=["y"],
    ...     dynamics=lambda s: {"x": (s.u - s.x) / s.T}, output=lambda s: {"y": s.x},
    ... )
    >>> t = 0.02 * np.arange(200)
    >>> step = cs.Record(name="step", t=t, channels={"u": np.where(t > 0.5, 1.0, 0.0)})
    >>> flown = cs.simulate(lag, step, [0.0], {"T": 0.4}).as_record("flown")
    >>> problem = cs.Problem(model=lag, records=[flown], free=["T"], noise={"y": 0.01})
    >>> fit = cs.solve(problem)
    >>> fit.result is cs.Results.CONVERGED
    True
    >>> print(cs.Results.NO_MINIMUM.value)
    The gradient vanishes where there is no minimum: start elsewhere.
    """

    CONVERGED = "A minimum of the cost that nothing contradicts."
    ANOTHER_MINIMUM = (
        "A minimum, and there is likely a lower one: use MultipleShooting(interval=1), Collocation() or "
        "solve(..., starts=20)."
    )
    NO_MINIMUM = "The gradient vanishes where there is no minimum: start elsewhere."
    NOT_IDENTIFIABLE = "The data do not determine every parameter: fix one, give a prior, or record more."
    STOPPED = "A limit was reached before the solution: raise iterations= or seconds=, or start nearer."
    DEPARTED = (
        "The simulation or a parameter ran off: use MultipleShooting() or Collocation(), check start values, units and "
        "time, or give bounds."
    )
    INFEASIBLE = "The constraints cannot be satisfied together: relax one."
    FAILED = "No step improves the fit, which is no minimum: start elsewhere, or look for a kink in the model."


# how the text of a status begins, or what it contains -> result; the first that fits
_WORDS = (
    ("converged", Results.CONVERGED),
    (ANOTHER_MINIMUM, Results.ANOTHER_MINIMUM),
    ("no minimum", Results.NO_MINIMUM),
    ("not identifiable", Results.NOT_IDENTIFIABLE),
    ("stopped", Results.STOPPED),
    ("departed", Results.DEPARTED),
    ("cannot be satisfied", Results.INFEASIBLE),
    ("apart", Results.NOT_IDENTIFIABLE),
    ("does not depend", Results.NOT_IDENTIFIABLE),
    ("hardly tell", Results.NOT_IDENTIFIABLE),
)


def result_of(status: str) -> Results:
    """The result that a status in words stands for."""
    if status == "converged":
        return Results.CONVERGED
    return next((result for words, result in _WORDS[1:] if words in status), Results.FAILED)


_BEYOND = 1e3  # times the root mean square of what was measured: no simulation that follows it is so far away
_RAN_OFF = 1e6  # times the larger of start and a-priori value: no data move a parameter there that they see


def status_in_words(problem: Problem, status: str, point: Point, errors: Uncertainty, method: Any) -> str:
    """The status of a fit: "converged", or what went wrong and what to do about it."""
    if status == "converged":
        return _not_identifiable(problem, point, errors)
    if status.startswith(("stopped", ANOTHER_MINIMUM)):
        return status
    if status == FLAT_MINIMUM:
        names = ", ".join(errors.confused or errors.weakest) or "every parameter"
        return f"not identifiable: at the maximum of the likelihood the data hardly tell {names}; fix or give a prior"
    cause = _no_number_at_start(problem)
    if cause:
        return f"failed: {cause}"
    advice = []
    if "diverges at the start" in status:
        single = type(method).__name__ == "SingleShooting"
        status = status.partition("; try")[0]
        advice.append(
            "try MultipleShooting()" if single else "check start values, units and time, or try Collocation()"
        )
    elif _ran_away(problem, errors):
        status = "departed: the simulation runs away from the measured motion"
        single = type(method).__name__ == "SingleShooting"
        advice.append(
            "use MultipleShooting()" if single else "check start values, units and time, or try Collocation()"
        )
    elif "ingular" in status or "told apart" in status or "no motion" in status or "no descent" in status:
        status = _plain(problem, status, errors)
    missing = _unguessed(problem)
    if missing:
        advice.append(
            f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} not measured and begin at zero: give "
            "define_model(guess=...) or InitialState(value={...})"
        )
    return "; ".join([status, *advice])


def _plain(problem: Problem, status: str, errors: Uncertainty) -> str:
    """What linear algebra says, for a person."""
    if "no descent" in status:
        return "failed: no step from here improves the fit, and it is no optimum: the model may have a kink here"
    idle = _idle(problem)
    if idle:
        return f"failed: the model does not depend on {', '.join(idle)}; fix {_it(idle)}, or give a prior"
    if errors.linear is not None and errors.confused:
        return f"failed: the data cannot tell {', '.join(errors.confused)} apart; fix one or give a prior"
    weak = ", ".join(errors.weakest)
    if weak:
        return f"failed: the data hardly tell {weak} near this point; start elsewhere, fix one or give a prior"
    return "failed: parameters or states cannot be told apart near this point; start elsewhere, fix one or give a prior"


def _not_identifiable(problem: Problem, point: Point, errors: Uncertainty) -> str:
    confused = errors.confused
    if not confused:
        return "converged"
    gone = _ran_off(problem, point)
    if gone:
        return f"departed: the iteration ran off to {', '.join(gone)}; start nearer, or give a prior or bounds"
    idle = [name for name in _idle(problem) if name in confused]
    if idle:
        return f"not identifiable: the model does not depend on {', '.join(idle)}; fix {_it(idle)}, or give a prior"
    if len(confused) == 1:
        return f"not identifiable: nothing in these data depends on {confused[0]}; fix it or give a prior"
    return f"not identifiable: the data cannot tell {', '.join(confused)} apart; fix one or give a prior"


def _ran_away(problem: Problem, errors: Uncertainty) -> bool:
    """Whether the simulated outputs are beyond anything that was measured."""
    if not problem.simulated:
        return False
    levels, squares = errors.value.noise.levels, errors.value.squares
    if isinstance(levels, FullNoise):
        return not np.isfinite(squares).all()
    measured = np.sqrt(levels.magnitude / np.maximum(levels.present, 1))
    return bool((~(levels.rms(squares) <= _BEYOND * measured) & (measured > 0.0)).any())


def _it(names: list[str]) -> str:
    return "it" if len(names) == 1 else "them"


def _ran_off(problem: Problem, point: Point) -> list[str]:
    """Parameters that are absurdly far away."""
    size = np.maximum(np.abs(problem.start_vector), np.abs(problem.nominal))
    far = np.abs(point.theta) > _RAN_OFF * np.where(size > 0.0, size, 1.0)
    return [f"{n} = {v:.3g}" for n, v, f in zip(problem.parameters, point.theta, far, strict=True) if f]


def _idle(problem: Problem) -> list[str]:
    """Free parameters that stand in no equation."""
    model = problem.model
    parts = [model.f, model.h, *model.events.values()]
    if model.equation is not None:
        parts.append(model.equation.prediction)
    used = ca.which_depends(ca.vertcat(*parts), model.p, 1, False)
    idle = {n for n, uses in zip(model.parameters, used, strict=True) if not uses}
    return [name for name in problem.parameters if name.split("[")[0] in idle]


def _unguessed(problem: Problem) -> list[str]:
    if not problem.simulated:
        return []
    names = unguessed_states(problem.model, problem.records)
    return [name for name in names if name not in {n.split("[")[0] for n in problem.initial_state.value}]


def _no_number_at_start(problem: Problem) -> str:
    """The derivative or output that is no number at the measured states and start values; "" when all are."""
    if not problem.simulated:
        return ""
    model = problem.model
    values = problem.start_parameters
    both = ca.vertcat(model.f, model.h)
    names = [f"the derivative of '{s}'" for s in model.states] + [f"output '{o}'" for o in model.outputs]
    function = ca.Function("at_start", [model.x, model.u, model.p, model.w], [both])
    calm = np.zeros(len(model.disturbances))
    for record, p in zip(problem.records, values, strict=True):
        U = record.matrix(model.inputs)
        X = model.guess(record)
        found = function.map(len(record))(
            X.T, U.T, np.tile(p[:, None], len(record)), np.tile(calm[:, None], len(record))
        )
        bad = np.argwhere(~np.isfinite(found.full().T))
        if len(bad):
            k, i = bad[0]
            at = {"x": X[k], "u": U[k], "p": p, "w": calm}
            return (
                f"at the start values {names[i]} is no number in record '{record.name}' at t = {record.t[k]:g} s: "
                f"{origin(both[int(i)], model.vectors, at)}"
            )
    return ""
