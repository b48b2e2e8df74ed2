"""Noise of the outputs as a problem states it: by a formula, log-normal, or with heavy tails."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

from casid.arguments import given, number, numbers_by_name, require
from casid.errors import InputError
from casid.model.expressions import Symbols, expressions
from casid.model.system import Model


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Noise of one output, for `Problem(noise={"y": cs.Noise(...)})`.

    Attributes
    ----------
    sigma
        Its 1-sigma: a number, the name of a channel of the records, or a function that takes a namespace of the model's
        parameters, inputs, states and outputs and returns an expression. Parameters of it are estimated like others.
    logarithmic
        Log-normal: the logarithm of the reading is normal about that of the output, and `sigma` is of the natural
        logarithm, dimensionless. All readings are positive.

    Raises
    ------
    InputError
        For a `sigma` that is none of these.

    Examples
    --------
    A constant part and one that is proportional to the output, both estimated:

    >>> cs.Noise(sigma=lambda s: s.sigma_a + s.sigma_b * s.y)  # doctest: +SKIP
    """

    sigma: float | str | Callable[[Any], Any]
    logarithmic: bool = False

    def __post_init__(self) -> None:
        require(self.logarithmic, bool, "Noise: logarithmic", "logarithmic=True or logarithmic=False")
        if isinstance(self.sigma, str) or callable(self.sigma):
            return
        if not isinstance(self.sigma, int | float):
            raise InputError(
                f"Noise: sigma is {given(self.sigma)}; expected a number, a channel, or a function like lambda s: s.a"
            )
        number(self.sigma, "Noise: sigma", positive=True)

    def expression(self, model: Model, output: str) -> ca.SX:
        """The 1-sigma in the symbols of the model; of a channel, in a symbol of the channel's name."""
        if isinstance(self.sigma, str):
            return ca.SX.sym(self.sigma)
        if not callable(self.sigma):
            return ca.SX(self.sigma)
        function = self.sigma
        where = f"Problem: noise of '{output}'"
        named = {
            name: vector[i]
            for vector, names in ((model.p, model.parameters), (model.u, model.inputs), (model.x, model.states))
            for i, name in enumerate(names)
        }
        space = Symbols(where, named | {name: model.h[i] for i, name in enumerate(model.outputs)})
        return expressions(lambda s: {"sigma": function(s)}, space, ("sigma",), "sigma", where)


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
    for name, value in numbers_by_name({} if sigma is None else sigma, f"{where}: sigma").items():
        number(value, f"{where}: sigma of '{name}'", positive=True)
