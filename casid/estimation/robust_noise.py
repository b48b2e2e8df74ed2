"""Noise with more large errors than the normal distribution has, as a problem states it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from casid.arguments import number, numbers_by_name


@dataclass(frozen=True, kw_only=True)
class StudentT:
    """Noise of Student's t distribution, for `Problem(noise=cs.StudentT())`: a reading far away hardly counts.

    Attributes
    ----------
    degrees
        Of freedom: the fewer, the more large errors. From about 30 it is normal noise.
    sigma
        Output -> scale of the distribution; None: it is estimated along with the parameters.

    Raises
    ------
    InputError
        For numbers that are not positive.

    Examples
    --------
    >>> import casid as cs
    >>> cs.StudentT(degrees=4.0)
    StudentT(degrees=4.0, sigma=None)
    """

    degrees: float = 4.0
    sigma: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        number(self.degrees, "StudentT: degrees", positive=True)
        _check_sigma(self.sigma, "StudentT")


@dataclass(frozen=True, kw_only=True)
class Huber:
    """Noise that is normal near zero with exponential tails, for `Problem(noise=cs.Huber())`: beyond the threshold a
    residual counts linearly (Huber, Ann. Math. Stat. 35, 1964).

    Attributes
    ----------
    threshold
        In units of sigma. At 1.345 the estimates have 95 % of the efficiency of least squares under normal noise.
    sigma
        Output -> scale of the distribution; None: it is estimated along with the parameters.

    Raises
    ------
    InputError
        For numbers that are not positive.

    Examples
    --------
    >>> import casid as cs
    >>> cs.Huber()
    Huber(threshold=1.345, sigma=None)
    """

    threshold: float = 1.345
    sigma: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        number(self.threshold, "Huber: threshold", positive=True)
        _check_sigma(self.sigma, "Huber")


def _check_sigma(sigma: Mapping[str, float] | None, where: str) -> None:
    for name, value in numbers_by_name(sigma or {}, f"{where}: sigma").items():
        number(value, f"{where}: sigma of '{name}'", positive=True)
