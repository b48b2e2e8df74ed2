"""Size of an effect in engineering terms, in units of the smallest size that matters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casid.diagnosis.evidence.evidence import coefficient_series, unlike_derivatives, variation
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached, disturbance_series, readings
from casid.model import station
from casid.model.causes.instruments import sensor_bias
from casid.model.terms import parse_term
from casid.signals import SURFACES


def meaningful_share(fitted: FlightFit, one: Attached) -> float:
    """Size of an effect, in units of the smallest size that matters."""
    return fitted.flight.sizes.share_of(fitted, one)


def missing_share(fitted: FlightFit, missing: MissingInput) -> float:
    """Share of a latent input: its r.m.s. over the variation at its port, or over a velocity for the air."""
    return fitted.flight.sizes.missing_share(fitted, missing)


def missing_size(fitted: FlightFit, missing: MissingInput) -> float:
    """Size of a latent input, in units of the smallest that matters."""
    return fitted.flight.sizes.missing_size(fitted, missing)


class AircraftSizes:
    """Sizes by the coefficients and channels of an aircraft."""

    def share_of(self, fitted: FlightFit, one: Attached) -> float:
        """Size of an effect, in units of the smallest size that matters.

        That size is the effect's own `meaningful`. For an effect that adds to a coefficient, it is a share of the
        coefficient's variation; the part that derivatives can reproduce is not counted. The share is larger for an
        effect that begins in mid-record.

        An effect between a record and its surface, or between a channel and its reading, must in addition have a
        consequence: it must change a coefficient or a channel by a part of its variation, or a channel by its noise. A
        surface that hardly moves may be slow without any consequence. A surface that is late by less than half a sample
        may not be late at all, because its motion between samples is unknown.

        An effect that is expected of some aircraft matters at any size, because without it another fault would be
        named.
        """
        effect = one.effect
        value = one.values["value"]
        criteria = fitted.criteria.size
        if effect.size.amplitude is not None:
            return consequence(fitted, one)
        smallest = fitted.flight.smallest_that_matters(effect)
        if smallest is not None:
            own = abs(value) / smallest if smallest > 0 else np.inf
            return min(own, consequence(fitted, one), _lateness(fitted, one) / fitted.criteria.parts.half)
        share = _coefficient_share(fitted, one) / (criteria.ambiguous if effect.members else criteria.share)
        return max(share, 1.0) if effect.traits.expected else share

    def missing_share(self, fitted: FlightFit, missing: MissingInput) -> float:
        """Share of a latent input: its r.m.s. over the variation of the coefficient or reading, for the air over a
        velocity."""
        place = missing.place
        criteria = fitted.criteria.size
        if place.kind == "wind":
            return missing.rms / (criteria.wind_along if place.name == "x" else criteria.wind_across)
        if place.kind == "coefficient":
            series = coefficient_series(fitted)[place.name]
            return missing.rms / max(float(np.std(series[fitted.batch.live])), 1e-12)
        channel = place.name
        series = fitted.read[..., fitted.model.outputs.index(channel)]
        return missing.rms / max(float(np.std(series[fitted.batch.live])), 1e-12)

    def missing_size(self, fitted: FlightFit, missing: MissingInput) -> float:
        """Size of a latent input, in units of the smallest that matters: of a share, or of a bias for a reading.

        A drift and a bias of one size matter alike, however much the reading varies.
        """
        if missing.place.kind == "reading":
            bias = fitted.flight.smallest_that_matters(sensor_bias(missing.place.name))
            return missing.largest / (bias or np.inf)
        return self.missing_share(fitted, missing) / fitted.criteria.size.share

    def told(self, fitted: FlightFit, one: Attached, std: float) -> tuple[float, float]:
        """Value and 1-sigma of a cause for a person."""
        return one.effect.in_words(one.values)["value"], std

    def told_at(self, fitted: FlightFit, missing: Sequence[MissingInput]) -> Sequence[MissingInput]:
        """The latent inputs that are reported: all."""
        return missing


def consequence(fitted: FlightFit, one: Attached) -> float:
    """Largest r.m.s. change that an effect on the signal path makes, in units of the smallest change that matters.

    For a surface it is the change of a coefficient over a part of its variation. For a reading it is the change of the
    channel over such a part or over its noise, whichever is smaller. It is infinite for other effects.
    """
    least = fitted.criteria.naming.approximate
    live = fitted.batch.live
    if one.effect.output is not None:
        plain, seen = without_and_with(fitted, one)
        change = np.std((seen - plain)[live], axis=0)
        size = np.std(plain[live], axis=0)
        noise = np.array([fitted.noise.measurement[name] for name in fitted.model.outputs])
        return float(np.max(change / np.maximum(np.minimum(least * size, noise), 1e-12)))
    if one.effect.target not in SURFACES or one.effect.series is None:
        return np.inf
    moved = _moved(fitted, one)
    shares = [0.0]
    for coefficient, size in variation(fitted).items():
        name = f"{coefficient}_{one.effect.target}"
        slope = fitted.derivatives.get(name, 0.0) + fitted.regressors.get(f"given {name}", 0.0)
        left = unlike_derivatives(fitted, coefficient, slope * moved, fitted.known)  # model without the effect
        shares.append(float(np.std(left[live])) / max(least * size, 1e-12))
    return max(shares)


def without_and_with(fitted: FlightFit, one: Attached) -> tuple[np.ndarray, np.ndarray]:
    """(N, R, ny) readings along the motion of a fit without one of its effects, and with it."""
    names = fitted.batch.names
    t = fitted.batch.t
    outputs = fitted.model.outputs
    plain = fitted.output
    without = [a for a in fitted.attached if a.name != one.name]
    if one.effect.symbolic:
        P = fitted.parameters.copy()
        P[:, fitted.model.parameters.index(one.name)] = 0.0
        plain = fitted.functions.output(fitted.linear.X, fitted.batch.U, P, fitted.moving)
    both = ((without, plain), ([*without, one], fitted.output))
    first, second = (readings(some, names, t, output, outputs, fitted.known) for some, output in both)
    return first, second


def _lateness(fitted: FlightFit, one: Attached) -> float:
    """Largest delay of a surface in sampling intervals; infinite for effects that do not delay it.

    The intervals are those of the averaged records: their inputs have straight lines between them too.
    """
    size = max(abs(one.values["value"]), 1e-12)
    if one.effect.target not in SURFACES or one.effect.unit not in ("s", "rad/s"):
        return np.inf
    late = size if one.effect.unit == "s" else float(np.max(np.abs(_moved(fitted, one)))) / size
    return late / float(np.median(fitted.batch.dt))


def _moved(fitted: FlightFit, one: Attached) -> np.ndarray:
    """(N, R) Difference that the effect makes between the surface and its record."""
    W = disturbance_series([one], fitted.batch.names, fitted.batch.t, fitted.known, fitted.model.disturbances)
    return W[..., fitted.model.disturbances.index(station.control(one.effect.target))]


def _coefficient_share(fitted: FlightFit, one: Attached) -> float:
    """R.m.s. of what the effect adds to its coefficient, over the variation of that coefficient."""
    size = variation(fitted)
    live = fitted.batch.live
    if one.effect.series is not None:
        W = disturbance_series([one], fitted.batch.names, fitted.batch.t, fitted.known, fitted.model.disturbances)
        series = {c: W[..., fitted.model.disturbances.index(station.coefficient(c))] for c in size}
        series = {c: values for c, values in series.items() if values.any()}
        if not one.effect.members:  # derivatives cannot reproduce a configuration change
            series = {c: unlike_derivatives(fitted, c, values) for c, values in series.items()}
        return max((float(np.std(v[live])) / max(size[c], 1e-12) for c, v in series.items()), default=0.0)
    series = one.values["value"] * parse_term(one.effect.regressor or "0").evaluate(fitted.regressors)
    left = unlike_derivatives(fitted, one.effect.target, np.broadcast_to(series, live.shape))
    return float(np.std(left[live])) / max(size[one.effect.target], 1e-12)
