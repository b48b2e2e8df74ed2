"""A digital control law in the loop of the simulation: it reads the state at a sample and holds its output."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from casid.arguments import require
from casid.errors import EstimationError
from casid.model.system import Model


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledFeedback:
    """A control law in discrete time: the inputs that it gives to the plant at a sample, held until the next one.

    The law is known, and must not depend on parameters. Outputs of the model that depend on u directly would contain
    the command instead of the surface, and raise an error.

    Attributes
    ----------
    model
        The model of the plant.
    received
        (inputs,) inputs of the plant, an expression in the model's x and u. Here u are the recorded commands, such as
        the stick, and not the surfaces.

    Raises
    ------
    EstimationError
        For a law that depends on parameters, or such an output.

    Examples
    --------
    After the example of `define_model`:

    >>> cs.SampledFeedback(model=lag, received=lag.u - 0.5 * lag.x).received.shape
    (1, 1)
    """

    model: Model
    received: ca.SX

    def __post_init__(self) -> None:
        model = require(self.model, Model, "SampledFeedback: model", "the model of the problem")
        require(self.received, ca.SX, "SampledFeedback: received", "an expression like model.u - 0.1 * model.x[1]")
        if self.received.shape != model.u.shape:
            got = self.received.shape[0]
            expected = len(model.inputs)
            raise EstimationError(f"SampledFeedback: {got} rows, the model '{model.name}' has {expected} inputs")
        strange = [s for s in ca.symvar(self.received) if not ca.depends_on(ca.vertcat(model.x, model.u), s)]
        if strange:
            raise EstimationError(
                f"SampledFeedback: depends on {strange}; expected states and inputs of the model only"
            )
        if ca.depends_on(model.h, model.u):
            raise EstimationError(
                f"SampledFeedback: outputs of '{model.name}' depend on inputs directly; leave them out"
            )

    def __getstate__(self) -> dict[str, Any]:
        law = ca.Function("law", [self.model.x, self.model.u], [self.received])  # symbols cannot be pickled
        return {"model": self.model, "received": law}

    def __setstate__(self, state: dict[str, Any]) -> None:
        model = state["model"]
        self.__dict__.update(model=model, received=state["received"](model.x, model.u))

    def at(self, x: ca.SX, u: ca.SX) -> ca.SX:
        """The received inputs at states x and commanded inputs u."""
        return ca.substitute([self.received], [self.model.x, self.model.u], [x, u])[0]
