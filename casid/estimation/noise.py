"""What may be said of the noise of one output beyond a number: a formula of its 1-sigma, log-normal noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from casid.arguments import an, given, number
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
        an(self.logarithmic, bool, "Noise: logarithmic", "logarithmic=True or logarithmic=False")
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
        function, where = self.sigma, f"Problem: noise of '{output}'"
        named = {
            name: vector[i]
            for vector, names in ((model.p, model.parameters), (model.u, model.inputs), (model.x, model.states))
            for i, name in enumerate(names)
        }
        space = Symbols(where, named | {name: model.h[i] for i, name in enumerate(model.outputs)})
        return expressions(lambda s: {"sigma": function(s)}, space, ("sigma",), "sigma", where)
