"""Compute how precisely a fit determines each parameter, in per cent, and which parameters it could do without."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from casid.frames import Rows, brief

# Guidelines of CIFER: Tischler and Remple, Aircraft and Rotorcraft System Identification, 2nd ed., AIAA 2012
CRAMER_RAO_LIMIT = 20.0
INSENSITIVITY_LIMIT = 10.0


class Estimated(Protocol):
    """Result with estimates and their covariance: a `Fit`, a `ResponseFit`."""

    @property
    def values(self) -> Mapping[str, float]:
        """Name -> estimate, in the order of the covariance."""
        ...

    @property
    def covariance(self) -> np.ndarray:
        """(parameters, parameters)."""
        ...


@dataclass(frozen=True, kw_only=True)
class ParameterPrecision:
    """Precision of one parameter.

    Attributes
    ----------
    value
        The estimate.
    cramer_rao_percent
        Its standard deviation in per cent of its size.
    insensitivity_percent
        The change, in per cent of its size, that costs as much as one standard deviation when no other parameter
        follows; never above the Cramer-Rao per cent.
    remark
        Which guideline it misses; "" for none.

    Examples
    --------
    After the example of `MeasuredResponse`:

    >>> K = cs.precision(cs.fit_transfer_functions(measured, {"p": roll})).parameters["K"]
    >>> K.insensitivity_percent <= K.cramer_rao_percent
    True
    """

    value: float
    cramer_rao_percent: float
    insensitivity_percent: float
    remark: str


@dataclass(frozen=True, repr=False, kw_only=True)
class Precision:
    """Precision of all parameters of a fit; print it for the table.

    Attributes
    ----------
    parameters
        Name -> its precision.
    drop
        Parameters to fix or to drop, in this order, until all others meet the guidelines at the present values: first
        the most insensitive one above 10 %, one by one, then the one with the largest Cramer-Rao bound above 20 %.
        Estimate again after each.

    Examples
    --------
    After the example of `precision`:

    >>> list(found.parameters), found.drop
    (['K_p', '1/T_roll', 'tau_p'], ('tau_p',))
    """

    parameters: dict[str, ParameterPrecision]
    drop: tuple[str, ...]

    __repr__ = brief

    def rows(self) -> Rows:
        """Parameters as rows."""
        heads = {"parameter": "", "value": ".5g", "Cramer-Rao %": ".2f", "insensitivity %": ".2f", "": ""}
        rows = [
            (name, one.value, one.cramer_rao_percent, one.insensitivity_percent, one.remark)
            for name, one in self.parameters.items()
        ]
        return Rows(heads=heads, rows=rows, keys={"": "remark"})

    def __str__(self) -> str:
        lines = [self.rows().text()]
        lines.append(f"guidelines: Cramer-Rao {CRAMER_RAO_LIMIT:g} %, insensitivity {INSENSITIVITY_LIMIT:g} %")
        if self.drop:
            lines.append(f"to fix or drop, one after the other: {', '.join(self.drop)}")
        return "\n".join(lines)


def precision(fit: Estimated) -> Precision:
    """Cramer-Rao and insensitivity per cent of every parameter of a fit, with the guidelines of CIFER.

    Parameters
    ----------
    fit
        From `solve`, `fit_transfer_functions` or `fit_state_space`.

    Returns
    -------
    Precision
        A row for each parameter, and the order in which parameters could be dropped.

    Notes
    -----
    With the information H, the inverse of the covariance, the Cramer-Rao bound is the square root of the diagonal of
    H^-1, and the insensitivity 1 over that of the diagonal of H. A parameter that is insensitive hardly changes the
    cost; one with a large bound and a small insensitivity is correlated with others. A parameter of value zero has
    infinite per cent.

    References
    ----------
    Tischler and Remple, Aircraft and Rotorcraft System Identification, 2nd ed., AIAA 2012, from which the field quotes
    a Cramer-Rao bound of at most 20 % and an insensitivity of at most 10 % as guidelines of a reliable parameter.

    Examples
    --------
    >>> import numpy as np, casid as cs
    >>> omega = np.geomspace(0.5, 12.0, 20)
    >>> response = -3.0 / (1j * omega + 1.5) * (1.0 + 0.05 * np.cos(9.0 * omega))
    >>> measured = cs.MeasuredResponse(input="delta_a", output="p", omega=omega, response=response)
    >>> found = cs.precision(cs.fit_transfer_functions(measured, "roll"))
    >>> found.drop
    ('tau_p',)
    """
    names = list(fit.values)
    size = np.abs(list(fit.values.values()))
    bound = _percent(np.sqrt(np.maximum(np.diagonal(fit.covariance), 0.0)), size)
    information = _information(fit.covariance)
    with np.errstate(divide="ignore"):
        insensitive = _percent(1.0 / np.sqrt(np.diagonal(information)), size)
    return Precision(
        parameters={
            name: ParameterPrecision(
                value=value,
                cramer_rao_percent=float(bound[i]),
                insensitivity_percent=float(insensitive[i]),
                remark=_remark(bound[i], insensitive[i]),
            )
            for i, (name, value) in enumerate(fit.values.items())
        },
        drop=tuple(names[i] for i in _order(information, size, insensitive)),
    )


def _percent(std: np.ndarray, size: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(std == 0.0, 0.0, 100.0 * std / size)


def _information(covariance: np.ndarray) -> np.ndarray:
    """Inverse of the covariance; infinite on the diagonal for a parameter without variance."""
    information = np.full(covariance.shape, np.nan)
    moving = np.flatnonzero(np.diagonal(covariance) > 0.0)
    held = np.flatnonzero(np.diagonal(covariance) == 0.0)
    if np.isfinite(covariance).all():
        information = np.zeros(covariance.shape)
        scale = 1.0 / np.sqrt(np.diagonal(covariance)[moving])
        inner = np.linalg.pinv(covariance[np.ix_(moving, moving)] * np.outer(scale, scale), hermitian=True)
        information[np.ix_(moving, moving)] = inner * np.outer(scale, scale)
        information[held, held] = np.inf
    return information


def _remark(bound: float, insensitive: float) -> str:
    if insensitive > INSENSITIVITY_LIMIT:
        return f"insensitive: above {INSENSITIVITY_LIMIT:g} %"
    if bound > CRAMER_RAO_LIMIT:
        return f"Cramer-Rao above {CRAMER_RAO_LIMIT:g} %, correlated with others"
    return "not determined by the data" if np.isnan(bound) else ""


def _order(information: np.ndarray, size: np.ndarray, insensitive: np.ndarray) -> list[int]:
    """Parameters to drop: the insensitive ones, then those with a large bound while the rest is estimated."""
    left = [i for i in range(len(size)) if np.isfinite(information[i, i])]
    dropped = [i for i in sorted(left, key=lambda i: -insensitive[i]) if insensitive[i] > INSENSITIVITY_LIMIT]
    left = [i for i in left if i not in dropped]
    while left:
        inner = np.linalg.pinv(information[np.ix_(left, left)], hermitian=True)
        bound = _percent(np.sqrt(np.maximum(np.diagonal(inner), 0.0)), size[left])
        worst = int(np.argmax(bound))
        if bound[worst] <= CRAMER_RAO_LIMIT:
            break
        dropped.append(left.pop(worst))
    return dropped
