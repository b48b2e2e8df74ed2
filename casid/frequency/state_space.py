"""Parameters of any model from several frequency responses at once: state-space identification with delays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from casid.arguments import names, numbers_by_name, require
from casid.errors import EstimationError, check_known
from casid.estimation.problem import chosen_parameters
from casid.frequency.model_response import Point, entering, linear_model, sensitivity_at
from casid.frequency.response_fit import AnyResponse, MeasuredResponse, ResponseFit, fit_responses, measured_responses
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
    measured = measured_responses(responses, band, where)
    for one in measured:
        check_known("input", (one.response.input,), model.inputs, f"{where}: model '{model.name}'")
        check_known("output", (one.response.output,), model.outputs, f"{where}: model '{model.name}'")
    chosen = chosen_parameters(names(free, f"{where}: free"), model, f"{where}: free")
    known = numbers_by_name(fixed or {}, f"{where}: fixed")
    late = {name: f"tau_{name}" for name in names(delays, f"{where}: delays")}
    check_known("input or output", late, (*model.inputs, *model.outputs), f"{where}: delays")
    own = [name for name in chosen if name not in known]
    begin = numbers_by_name(start or {}, f"{where}: start")
    every = [*own, *(tau for tau in late.values() if tau not in known)]
    check_known("free parameter", begin, every, f"{where}: start")
    of_model = {name: value for name, value in known.items() if name not in late.values()}
    point = linear_model(model, at if at is not None else {}, values=of_model).point
    index = np.array([model.parameters.index(name) for name in own], dtype=int)
    idle = [name for name, used in zip(own, entering(model, index), strict=True) if not used] if own else []
    if idle:
        raise EstimationError(f"{where}: {', '.join(idle)} do not enter the linear model of '{model.name}'; fix them")
    x = np.array([point[name] for name in model.states])
    u = np.array([point[name] for name in model.inputs])

    def respond(one: MeasuredResponse, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Respond`."""
        table = known | dict(zip(every, values.tolist(), strict=True))
        p = model.nominal_vector(of_model | {name: table[name] for name in own})
        gain, slopes = sensitivity_at(model, index, x, u, p).response(one.omega)
        row = model.outputs.index(one.output)
        column = model.inputs.index(one.input)
        found = gain[:, row, column]
        gradient = np.zeros((len(found), len(values)), complex)
        with np.errstate(all="ignore"):
            gradient[:, : len(own)] = slopes[:, :, row, column] / found[:, None]
        for tau in (tau for name, tau in late.items() if name in (one.input, one.output)):
            found = found * np.exp(-1j * one.omega * table[tau])
            gradient[:, [name == tau for name in every]] = -1j * one.omega[:, None]
        return found, gradient

    starts = [{name: begin.get(name, model.nominal.get(name, 0.0)) for name in every}]
    return fit_responses(respond, measured, starts, every, known)
