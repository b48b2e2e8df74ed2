"""How a solution can end, each with what to do about it."""

from __future__ import annotations

from enum import Enum

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
