"""Parameters of any model from several frequency responses at once: state-space identification with delays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from casid.arguments import names, numbers_by_name, require
from casid.errors import EstimationError, check_known
from casid.estimation.problem import chosen_parameters
from casid.frequency.model_response import Point, linear_model
from casid.frequency.regression import check_band
from casid.frequency.response_fit import AnyResponse, MeasuredResponse, ResponseFit, fit_responses, measured_responses
from casid.frequency.sensitivity import entering, sensitivity_at
from casid.model.system import Model


def fit_state_space(
    model: Model,
    responses: AnyResponse | Sequence[AnyResponse],
    *,
    free: Sequence[str],
    at: Point | None = None,
    delays: Sequence[str] = (),
    fixed: Mapping[str, float] | None = None,
    start: Mapping[str, float] | None = None,
    band: tuple[float, float] | None = None,
) -> ResponseFit:
    """Estimate parameters of a model from frequency responses, by exact linearisation at an operating point.

    Parameters
    ----------
    model
        Any model; entries of its matrices, or whatever they follow from, are its parameters.
    responses
        From `frequency_response` or `MeasuredResponse`, of inputs and outputs that the model has.
    free
        Globs of parameters to estimate.
    at
        The operating point, as `linear_model` takes it; default: all states and inputs zero, for a linear model.
    delays
        Inputs and outputs with a delay, estimated under the name "tau_<input>".
    fixed
        Name -> value of what is not estimated; all others stay nominal.
    start
        Name -> start value; default: nominal, and no delay.
    band
        (low, high) [rad/s]; default: wherever the coherence is at least 0.6, below which nothing is used.

    Returns
    -------
    ResponseFit
        Values, standard deviations, Cramer-Rao and insensitivity per cent, and the cost J of each response.

    Raises
    ------
    InputError
        For a name that does not exist, the same response twice, and no usable frequency.
    EstimationError
        For a free parameter that does not enter the linear model, and start values without a finite response.

    Notes
    -----
    The sum of the costs J of `compare_responses` is minimised, as by `fit_transfer_functions`.

    References
    ----------
    Tischler and Remple, Aircraft and Rotorcraft System Identification, 2nd ed., AIAA 2012.

    Examples
    --------
    After the example of `track_derivatives`:

    >>> omega = np.geomspace(0.5, 12.0, 20)
    >>> truth = -8.0 / (1j * omega + 2.0) * np.exp(-0.05j * omega)
    >>> measured = cs.MeasuredResponse(input="delta_a", output="p", omega=omega, response=truth)
    >>> fit = cs.fit_state_space(roll, measured, free=["L*"], delays=["delta_a"])
    >>> {name: round(value, 6) for name, value in fit.values.items()}
    {'Lp': -2.0, 'Lda': -8.0, 'tau_delta_a': 0.05}
    """
    where = "fit_state_space"
    require(model, Model, f"{where}: model", "cs.aircraft_model(aircraft) or cs.define_model(...)")
    measured = measured_responses(responses, None if band is None else check_band(band, where), where)
    for one in measured:
        check_known("input", (one.response.input,), model.inputs, f"{where}: model '{model.name}'")
        check_known("output", (one.response.output,), model.outputs, f"{where}: model '{model.name}'")
    chosen = chosen_parameters(names(free, f"{where}: free"), model, f"{where}: free")
    known = numbers_by_name(fixed or {}, f"{where}: fixed")
    late = names(delays, f"{where}: delays")
    check_known("input or output", late, (*model.inputs, *model.outputs), f"{where}: delays")
    own = tuple(name for name in chosen if name not in known)
    begin = numbers_by_name(start or {}, f"{where}: start")
    free_names = (*own, *(f"tau_{name}" for name in late if f"tau_{name}" not in known))
    check_known("free parameter", begin, free_names, f"{where}: start")
    of_model = {name: value for name, value in known.items() if name not in {f"tau_{one}" for one in late}}
    point = linear_model(model, at if at is not None else {}, values=of_model).point
    index = np.array([model.parameters.index(name) for name in own], dtype=int)
    idle = [name for name, used in zip(own, entering(model, index), strict=True) if not used] if own else []
    if idle:
        raise EstimationError(f"{where}: {', '.join(idle)} do not enter the linear model of '{model.name}'; fix them")
    problem = _Linear(
        model=model,
        names=free_names,
        index=index,
        known=model.nominal_vector(of_model),
        delays={name: known.get(f"tau_{name}", 0.0) for name in late},
        x=np.array([point[name] for name in model.states]),
        u=np.array([point[name] for name in model.inputs]),
    )
    starts = np.array([[begin.get(name, model.nominal.get(name, 0.0)) for name in free_names]])
    return fit_responses(problem, measured, starts, known)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Linear:
    """A model about states x and inputs u with delays, of which some parameters are free: a `ResponseModel`."""

    model: Model
    names: tuple[str, ...]
    index: np.ndarray
    known: np.ndarray
    delays: Mapping[str, float]
    x: np.ndarray
    u: np.ndarray

    def response(self, one: MeasuredResponse, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(M,) response at the frequencies of `one`, and (M, parameters) the derivatives of its logarithm."""
        p = self.known.copy()
        p[self.index] = values[: len(self.index)]
        linear = sensitivity_at(self.model, self.index, self.x, self.u, p)
        row = self.model.outputs.index(one.output)
        column = self.model.inputs.index(one.input)
        gain, slopes = linear.response(one.omega)
        found = gain[:, row, column]
        with np.errstate(all="ignore"):
            gradient = np.zeros((len(found), len(values)), complex)
            gradient[:, : len(self.index)] = slopes[:, :, row, column] / found[:, None]
        for name, delay in self.delays.items():
            if name in (one.input, one.output):
                if f"tau_{name}" in self.names:
                    place = self.names.index(f"tau_{name}")
                    delay = values[place]
                    gradient[:, place] = -1j * one.omega
                found = found * np.exp(-1j * one.omega * delay)
        return found, gradient
