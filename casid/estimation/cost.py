"""What is minimised: the cost, independent of how the trajectory is represented and of who minimises."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casid.errors import EstimationError


@dataclass(frozen=True, kw_only=True)
class OutputError:
    """Measured minus simulated outputs (paper eq. 10)."""


@dataclass(frozen=True, kw_only=True)
class EquationError:
    """Measured minus modelled right-hand sides, evaluated on measured signals (paper eq. 6-9): no simulation."""


@dataclass(frozen=True, kw_only=True)
class CombinedError:
    """Both (paper eq. 11-12): (1 - equation_weight) * output part + equation_weight * equation part.

    Raises EstimationError when the weight is not inside (0, 1): at the ends it is one of the two pure costs.
    """

    equation_weight: float = 0.5

    def __post_init__(self) -> None:
        if not 0.0 < self.equation_weight < 1.0:
            raise EstimationError(
                f"CombinedError: equation_weight is {self.equation_weight}; expected a number inside (0, 1); "
                "use OutputError or EquationError for a pure cost"
            )


Cost = OutputError | EquationError | CombinedError


@dataclass(frozen=True, kw_only=True)
class RangeWeights:
    """Weights instead of noise variances: w = min(1/(max z - min z), maximum) per channel (paper eq. 13).

    Only their proportions matter; standard errors use the variance found in the residuals of each channel.
    """

    maximum: float = 1e4

    def weights(self, measured: np.ndarray) -> np.ndarray:
        """(channels,) weights of the (samples, channels) measurements; NaN are missing samples."""
        low, high = np.nanmin(measured, axis=0), np.nanmax(measured, axis=0)
        return np.minimum(1.0 / np.maximum(high - low, 1e-300), self.maximum)


def cost_weights(cost: Cost) -> tuple[float, float]:
    """(weight of the output part, weight of the equation part) in the sum of squares."""
    if isinstance(cost, CombinedError):
        return 1.0 - cost.equation_weight, cost.equation_weight
    return (1.0, 0.0) if isinstance(cost, OutputError) else (0.0, 1.0)
