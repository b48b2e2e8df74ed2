"""Define the cost that is minimised, independent of how the trajectory is represented and of who minimises."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from casid.arguments import given, number
from casid.errors import EstimationError, InputError


class Cost(Protocol):
    """Weights of a cost: the factor of half the sum of squares of each kind of whitened residual.

    Any object with these two numbers, not negative and not both zero, is a cost. A part that weighs nothing is not
    computed: without the output part nothing is simulated. A model without states has outputs only, which are its
    equations: there the sum of both weights counts. A cost that makes its equation part itself is an `OwnEquations`
    besides (`casid.estimation.transcriptions.equation`).
    """

    @property
    def output_weight(self) -> float:
        """Weight of measured minus simulated outputs."""
        ...

    @property
    def equation_weight(self) -> float:
        """Weight of measured minus modelled right-hand sides."""
        ...


@runtime_checkable
class OwnLikelihood(Protocol):
    """A cost that makes its likelihood itself, such as `FilterError`; weights it need not have."""

    def likelihood(self, problem: Any) -> Any:
        """The `Likelihood` of a problem. Raises EstimationError for a problem that it cannot take."""
        ...


class Likelihood(Protocol):
    """-2 ln L = r'r + log determinant + m ln(2 pi), of m whitened residuals r as functions of the parameters.

    Any object with these methods is one. Parameters are in the order of `problem.parameters`; their priors and limits
    are those of the problem.
    """

    def residual(self, theta: np.ndarray) -> np.ndarray:
        """(m,) predicted minus measured over its standard deviation, white at the truth; not finite where the
        prediction departs."""
        ...

    def jacobian(self, theta: np.ndarray) -> np.ndarray:
        """(m, parameters) derivative of `residual`."""
        ...

    def log_determinant(self, theta: np.ndarray) -> float:
        """ln(determinant) of the covariance of the readings; a step takes it as constant."""
        ...


def weights_of(cost: Any) -> tuple[float, float]:
    """Weights of the output and of the equation part of a cost; a likelihood of its own counts as one of outputs."""
    if isinstance(cost, OwnLikelihood):
        return 1.0, 0.0
    return float(cost.output_weight), float(cost.equation_weight)


@dataclass(frozen=True, kw_only=True)
class OutputError:
    """Measured minus simulated outputs (AIAA 2010-34, eq. 10).

    Examples
    --------
    It is the cost of a problem that names no other. After the example of `solve`:

    >>> problem = cs.Problem(model=lag, records=[flown], free=["T"], noise={"y": 0.01}, cost=cs.OutputError())
    >>> round(cs.solve(problem).values["T"], 3)
    0.4
    """

    @property
    def output_weight(self) -> float:
        """The whole cost."""
        return 1.0

    @property
    def equation_weight(self) -> float:
        """No part of the cost."""
        return 0.0


@dataclass(frozen=True, kw_only=True)
class EquationError:
    """Measured minus modelled right-hand sides, evaluated on measured signals (AIAA 2010-34, eq. 6-9): no simulation.

    Examples
    --------
    After the example of `simulate`:

    >>> sine = cs.Record(name="sine", t=t, channels={"u": np.sin(3.0 * t)})
    >>> simulation = cs.simulate(lag, sine, [0.0], {"T": 0.4})
    >>> flown = sine.with_channels(x=simulation.state("x"), y=simulation.output("y"))
    >>> fit = cs.solve(cs.Problem(model=lag, records=[flown], free=["T"], cost=cs.EquationError()))
    >>> abs(fit.values["T"] - 0.4) < 0.02
    True
    """

    @property
    def output_weight(self) -> float:
        """No part of the cost."""
        return 0.0

    @property
    def equation_weight(self) -> float:
        """The whole cost."""
        return 1.0


@dataclass(frozen=True, kw_only=True)
class CombinedError:
    """Weighted sum of output and equation error: (1 - equation_weight) * output + equation_weight * equation.

    Equations 11 and 12 of E. Özger, AIAA 2010-34.

    Attributes
    ----------
    equation_weight
        Weight of the equation error, inside (0, 1).

    Raises
    ------
    EstimationError
        When the weight is not inside (0, 1): at the ends it is one of the two pure costs.

    Examples
    --------
    After the example of `solve`:

    >>> both = flown.with_channels(x=flown["y"])  # an equation error needs the states
    >>> cost = cs.CombinedError(equation_weight=0.3)
    >>> problem = cs.Problem(model=lag, records=[both], free=["T"], noise={"y": 0.01, "xdot": 0.1}, cost=cost)
    >>> round(cs.solve(problem).values["T"], 2)
    0.4
    """

    equation_weight: float = 0.5

    def __post_init__(self) -> None:
        if not 0.0 < number(self.equation_weight, "CombinedError: equation_weight") < 1.0:
            raise EstimationError(
                f"CombinedError: equation_weight is {self.equation_weight}; expected a number inside (0, 1); "
                "use OutputError or EquationError for a pure cost"
            )

    @property
    def output_weight(self) -> float:
        """Return the weight that the equation part leaves."""
        return 1.0 - self.equation_weight


@dataclass(frozen=True, kw_only=True)
class RangeWeights:
    """Weights instead of noise variances: w = min(1/(max z - min z), maximum) per channel.

    Equation 13 of E. Özger, AIAA 2010-34. Each residual is multiplied by w before it is squared. Only ratios of
    weights affect the estimates. Standard errors use the residual variance of each channel.

    Attributes
    ----------
    maximum
        Largest weight, for channels that hardly move.

    Examples
    --------
    After the example of `solve`:

    >>> problem = cs.Problem(model=lag, records=[flown], free=["T"], noise=cs.RangeWeights())
    >>> round(cs.solve(problem).values["T"], 2)
    0.4
    """

    maximum: float = 1e4

    def __post_init__(self) -> None:
        number(self.maximum, "RangeWeights: maximum", positive=True)

    def weights(self, measured: np.ndarray) -> np.ndarray:
        """(channels,) weights of the (samples, channels) measurements; NaN are missing samples."""
        low = np.nanmin(measured, axis=0)
        high = np.nanmax(measured, axis=0)
        return np.minimum(1.0 / np.maximum(high - low, 1e-300), self.maximum)


def check_cost(cost: Any) -> None:
    """Raise InputError for what is no cost, with what to write."""
    expected = "expected cs.OutputError(), cs.EquationError(), cs.CombinedError() or an object of your own with both"
    if isinstance(cost, type):
        raise InputError(f"Problem: cost is the class {cost.__name__}; write cost={cost.__name__}()")
    if isinstance(cost, OwnLikelihood):
        return
    name = type(cost).__name__
    if not callable(getattr(cost, "equations", None)):
        for method in ("residual", "residuals", "jacobian", "log_determinant"):
            if callable(getattr(cost, method, None)):
                raise InputError(
                    f"Problem: cost is a {name} whose method '{method}' nothing would call; give it a method "
                    "likelihood(problem) that returns an object with residual(theta), jacobian(theta) and "
                    "log_determinant(theta)"
                )
    weights: list[Any] = [getattr(cost, name, None) for name in ("output_weight", "equation_weight")]
    if None in weights:
        raise InputError(f"Problem: cost is {given(cost)}, without output_weight and equation_weight; {expected}")
    if not all(isinstance(w, int | float) and 0.0 <= w < np.inf for w in weights) or sum(weights) == 0.0:
        raise InputError(
            f"Problem: the cost weighs outputs with {weights[0]!r} and equations with {weights[1]!r}; expected "
            "numbers that are not negative and not both zero"
        )
