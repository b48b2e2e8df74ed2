"""Transfer functions and low-order equivalent systems with a time delay, fitted to several frequency responses at once.

The logarithm of a response is the sum of the logarithms of its factors, so that each derivative is that of one factor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from types import MappingProxyType
from typing import Any

import numpy as np

from casid.arguments import given, names, numbers_by_name, one_line, require, sequence
from casid.errors import InputError, check_known
from casid.frequency.response_fit import (
    AnyResponse,
    Measured,
    MeasuredResponse,
    ResponseFit,
    fit_responses,
    measured_responses,
)

# Starts: where frequencies of pairs lie in the band, from its lower end (0) to the upper one (1) by ratio, and so for
# real zeros and poles; damping ratios.
_PAIRS = (0.3, 0.5, 0.7)
_REAL = (0.2, 0.7)
_DAMPING = (0.2, 0.7)


@dataclass(frozen=True, kw_only=True)
class TransferFunction:
    """A transfer function by the names of its parameters; a name that several of them have is one parameter.

    K s^-integrators prod(s + zero) prod(s^2 + 2 zeta omega s + omega^2) exp(-delay s) / (the same of poles).

    Attributes
    ----------
    gain
        Name of K, in SI units.
    zeros, poles
        Names of 1/T [1/s] in (s + 1/T), negative in the right half plane.
    zero_pairs, pole_pairs
        Names (zeta, omega) of damping ratio and natural frequency [rad/s].
    integrators
        Poles at zero; negative for zeros there.
    delay
        Name of the equivalent time delay [s]; "" for none.

    Examples
    --------
    >>> import casid as cs
    >>> cs.TransferFunction(gain="K_q", zeros=["1/T_theta2"], pole_pairs=[("zeta_sp", "omega_sp")], delay="tau_q").names
    ('K_q', '1/T_theta2', 'zeta_sp', 'omega_sp', 'tau_q')
    """

    gain: str
    zeros: Sequence[str] = ()
    poles: Sequence[str] = ()
    zero_pairs: Sequence[tuple[str, str]] = ()
    pole_pairs: Sequence[tuple[str, str]] = ()
    integrators: int = 0
    delay: str = ""

    def __post_init__(self) -> None:
        for what in ("gain", "delay"):
            one_line(getattr(self, what), f"TransferFunction: {what}")
        for what in ("zeros", "poles"):
            names(getattr(self, what), f"TransferFunction: {what}")
        for what in ("zero_pairs", "pole_pairs"):
            where = f"TransferFunction: {what}"
            for pair in sequence(getattr(self, what), where, "[('zeta', 'omega')]"):
                if len(names(pair, f"{where}: a pair")) != 2:
                    raise InputError(f"{where}: a pair is {given(pair)}; expected ('zeta', 'omega')")
        if not isinstance(self.integrators, int) or isinstance(self.integrators, bool):
            raise InputError(f"TransferFunction: integrators is {given(self.integrators)}; expected a whole number")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its parameters."""
        pairs = [name for pair in (*self.zero_pairs, *self.pole_pairs) for name in pair]
        return (self.gain, *self.zeros, *self.poles, *pairs, *([self.delay] if self.delay else []))

    def response(self, omega: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
        """(frequencies,) complex response at omega (frequencies,) [rad/s], with values by parameter."""
        return self.with_slopes(omega, values)[0]

    def with_slopes(self, omega: np.ndarray, values: Mapping[str, float]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return the `response`, and name -> (frequencies,) derivative of its logarithm."""
        s = 1j * np.asarray(omega, dtype=float)
        found = values[self.gain] * s**-self.integrators
        slopes = {name: np.zeros(len(s), complex) for name in self.names}
        slopes[self.gain] += 1.0 / values[self.gain]
        for sign, real, pairs in ((1, self.zeros, self.zero_pairs), (-1, self.poles, self.pole_pairs)):
            for name in real:
                factor = s + values[name]
                found = found * factor**sign
                slopes[name] += sign / factor
            for zeta, omega_n in pairs:
                damping = values[zeta]
                frequency = values[omega_n]
                factor = s**2 + 2.0 * damping * frequency * s + frequency**2
                found = found * factor**sign
                slopes[zeta] += sign * 2.0 * frequency * s / factor
                slopes[omega_n] += sign * 2.0 * (damping * s + frequency) / factor
        if self.delay:
            found = found * np.exp(-s * values[self.delay])
            slopes[self.delay] -= s
        return found, slopes


def _low_order(output: str, **rest: Any) -> TransferFunction:
    """Make a form with its own gain and delay."""
    return TransferFunction(gain=f"K_{output}", delay=f"tau_{output}", **rest)


_SHORT_PERIOD = {"pole_pairs": [("zeta_sp", "omega_sp")]}
_DUTCH_ROLL = {"pole_pairs": [("zeta_dr", "omega_dr")]}
LOW_ORDER: Mapping[str, Mapping[str, TransferFunction]] = MappingProxyType(
    {
        "short period": {
            "q": _low_order("q", zeros=["1/T_theta2"], **_SHORT_PERIOD),
            "theta": _low_order("theta", zeros=["1/T_theta2"], integrators=1, **_SHORT_PERIOD),
            "alpha": _low_order("alpha", **_SHORT_PERIOD),
            "az": _low_order("az", **_SHORT_PERIOD),
        },
        "roll": {
            "p": _low_order("p", poles=["1/T_roll"]),
            "phi": _low_order("phi", poles=["1/T_roll"], integrators=1),
        },
        "roll and dutch roll": {
            "p": _low_order("p", poles=["1/T_roll"], zero_pairs=[("zeta_phi", "omega_phi")], **_DUTCH_ROLL),
        },
        "dutch roll": {
            "beta": _low_order("beta", **_DUTCH_ROLL),
            "r": _low_order("r", zeros=["1/T_r"], **_DUTCH_ROLL),
        },
    }
)


def fit_transfer_functions(
    responses: AnyResponse | Sequence[AnyResponse],
    form: str | Mapping[str, TransferFunction],
    *,
    band: tuple[float, float] | None = None,
    fixed: Mapping[str, float] | None = None,
    start: Mapping[str, float] | None = None,
) -> ResponseFit:
    """Fit transfer functions, such as a low-order equivalent system, to one or more frequency responses together.

    Parameters
    ----------
    responses
        From `frequency_response` or `MeasuredResponse`; each with another output.
    form
        "short period" (outputs q, theta, alpha, az), "roll" (p, phi), "roll and dutch roll" (p) or "dutch roll" (beta,
        r); or a table output -> `TransferFunction`. Parameters of the same name are shared: damping ratio, natural
        frequency and 1/T_theta2 come from all responses, gain and delay from each.
    band
        (low, high) [rad/s]; default: wherever the coherence is at least 0.6, below which nothing is used.
    fixed
        Name -> value of parameters that are known, such as 1/T_theta2.
    start
        Name -> start value; default: several from the band.

    Returns
    -------
    ResponseFit
        Values, standard deviations, Cramer-Rao and insensitivity per cent, and the cost J of each response.

    Raises
    ------
    InputError
        For an output without a form, the same response twice, a name that does not exist, and no usable frequency.
    EstimationError
        For start values without a finite response.

    Notes
    -----
    The sum of the costs J of `compare_responses` is minimised, at all given frequencies, so these should be spaced
    evenly by ratio. Its derivatives are exact.

    References
    ----------
    Tischler and Remple, Aircraft and Rotorcraft System Identification, 2nd ed., AIAA 2012; MIL-STD-1797 on equivalent
    systems.

    Examples
    --------
    >>> import numpy as np, casid as cs
    >>> omega = np.geomspace(0.5, 12.0, 20)
    >>> form = {"p": cs.TransferFunction(gain="K", poles=["1/T_roll"], delay="tau")}
    >>> truth = form["p"].response(omega, {"K": -3.0, "1/T_roll": 1.5, "tau": 0.1})
    >>> measured = cs.MeasuredResponse(input="delta_a", output="p", omega=omega, response=truth)
    >>> fit = cs.fit_transfer_functions(measured, form)
    >>> round(fit["1/T_roll"].value, 6), round(fit["tau"].value, 6)
    (1.5, 0.1)
    """
    where = "fit_transfer_functions"
    forms = _forms(form)
    measured = measured_responses(responses, band, where)
    outputs = [one.response.output for one in measured]
    for output in outputs:
        check_known("output", (output,), forms, f"{where}: form")
        if outputs.count(output) > 1:
            raise InputError(f"{where}: two responses of '{output}'; expected one for each form")
    used = {output: forms[output] for output in outputs}
    names = tuple(dict.fromkeys(name for one in used.values() for name in one.names))
    known = numbers_by_name(fixed or {}, f"{where}: fixed")
    begin = numbers_by_name(start or {}, f"{where}: start")
    for table in (known, begin):
        check_known("parameter", table, names, where)
    free = tuple(name for name in names if name not in known)
    if not free:
        raise InputError(f"{where}: every parameter is fixed; expected one that is free")

    def respond(one: MeasuredResponse, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Respond`."""
        found, slopes = used[one.output].with_slopes(one.omega, dict(zip(free, values.tolist(), strict=True)) | known)
        nothing = np.zeros(len(one.omega))
        return found, np.stack([slopes.get(name, nothing) for name in free], axis=1)

    fit = fit_responses(respond, measured, _starts(used, measured, known | begin), free, known)
    positive = _positive(used, fit.values)
    return fit if positive == fit.values else fit_responses(respond, measured, [positive], free, known)


def _forms(form: str | Mapping[str, TransferFunction]) -> Mapping[str, TransferFunction]:
    where = "fit_transfer_functions: form"
    if isinstance(form, str):
        check_known("form", (form,), LOW_ORDER, "fit_transfer_functions")
        return LOW_ORDER[form]
    for one in require(form, Mapping, where, '"short period" or {"q": cs.TransferFunction(gain="K_q", ...)}').values():
        require(one, TransferFunction, where, 'cs.TransferFunction(gain="K_q", ...)')
    return form


def _starts(
    forms: Mapping[str, TransferFunction], measured: Sequence[Measured], given: Mapping[str, float]
) -> list[dict[str, float]]:
    """Start values of all parameters, with gains as the responses then want them."""
    omega = np.concatenate([one.response.omega for one in measured])
    low = float(omega.min())
    high = float(omega.max())
    pairs = _pairs(forms)
    real = list(dict.fromkeys(n for one in forms.values() for n in (*one.poles, *one.zeros)))
    found = []
    for at, damping, place in product(_PAIRS if pairs else (0.5,), _DAMPING if pairs else (0.5,), _REAL):
        table = {one.delay: 0.0 for one in forms.values() if one.delay}
        for i, (zeta, frequency) in enumerate(pairs):
            table |= {zeta: damping, frequency: low * (high / low) ** ((i + at) / len(pairs))}
        table |= {name: low * (high / low) ** ((i + place) / len(real)) for i, name in enumerate(real)}
        table |= given
        for one in measured:
            own = forms[one.response.output]
            if own.gain not in given:
                ratio = one.response.response / own.response(one.response.omega, table | {own.gain: 1.0})
                sign = 1.0 if np.sum(np.cos(np.angle(ratio))) >= 0.0 else -1.0
                table[own.gain] = sign * float(np.exp(np.mean(np.log(np.abs(ratio)))))
        found.append(table)
    return found


def _pairs(forms: Mapping[str, TransferFunction]) -> list[tuple[str, str]]:
    return list(dict.fromkeys(pair for one in forms.values() for pair in (*one.pole_pairs, *one.zero_pairs)))


def _positive(forms: Mapping[str, TransferFunction], values: Mapping[str, float]) -> dict[str, float]:
    """The same transfer functions with positive natural frequencies."""
    found = dict(values)
    for zeta, frequency in _pairs(forms):
        if found.get(frequency, 1.0) < 0.0 and zeta in found:
            found[zeta], found[frequency] = -found[zeta], -found[frequency]
    return found
