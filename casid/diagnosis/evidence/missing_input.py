"""Latent inputs: a Gaussian-process input at each port of the signal path, which shows where something is missing.

For every coefficient, every axis of moving air and every reading, an unknown time history with covariance s^2
exp(-|t|/tau) on a grid of nodes is added to the fitted model. Its exact marginal likelihood-ratio statistic, with the
fitted parameters eliminated and s and tau maximised, shows where something is missing before a cause is named, and
whether something remains afterwards. A latent input at a reading is slow, like the drift of an instrument; a fast one
could imitate anything.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy import special

from casid.diagnosis.evidence.evidence import Evidence
from casid.diagnosis.evidence.fingerprints import Projection, products_at, white_at
from casid.diagnosis.flight.evaluation import FlightFit, gram_of
from casid.diagnosis.numerics import MissingInputNumerics
from casid.model.station import Station
from casid.native.processors import side_by_side


def _grams(fit: FlightFit) -> dict[str, np.ndarray]:
    """Port -> (R, n, n) products of the responses to a unit at the nodes, as far as they are known: with and without
    model discrepancy, and for every later evidence of the same fit, they are the same."""
    return fit.kept.small.setdefault("products at the nodes of ports", {})


@dataclass(frozen=True, eq=False, kw_only=True)
class MissingInput:
    """A latent input at a port (`station`)."""

    station: str  # the port
    gain: float  # likelihood-ratio statistic
    size: float  # prior 1-sigma, or amplitude of an oscillation
    history: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]  # record -> (times of the nodes, estimate, 1-sigma)
    # frequency [Hz] of an oscillation; else None
    frequency: float | None = None  # Hz, of an oscillation
    called: str = ""  # the port in words, if these are not `place.words`

    @property
    def place(self) -> Station:
        """The port where it enters."""
        return Station.at(self.station)

    @property
    def words(self) -> str:
        """The port in words."""
        return self.called or self.place.words

    def concerns(self, records: Iterable[str]) -> bool:
        """Return True if it is missing in one of these records."""
        return not self.history.keys().isdisjoint(records)

    @property
    def rms(self) -> float:
        """Root mean square about the mean, in the unit of the port."""
        return float(np.std(np.concatenate([mean for _, mean, _ in self.history.values()])))

    @property
    def largest(self) -> float:
        """Largest deviation from the mean of its record, in the unit of the port."""
        return max(float(np.max(np.abs(mean - np.mean(mean)))) for _, mean, _ in self.history.values())


def moving_air(evidence: Evidence) -> list[MissingInput]:
    """A latent velocity of the air along each axis, largest statistic first."""
    return missing_at(
        evidence, [station for station in evidence.fit.flight.stations if Station.at(station).kind == "wind"]
    )


def missing_inputs(evidence: Evidence) -> list[MissingInput]:
    """A latent input at each port, largest statistic first."""
    return missing_at(evidence, [*evidence.fit.flight.stations, *evidence.fit.flight.readings])


def missing_at(evidence: Evidence, names: Sequence[str]) -> list[MissingInput]:
    """A latent input at each of these ports, largest statistic first."""
    grids = {slow: _grid(evidence, slow) for slow in {Station.at(name).kind == "reading" for name in names}}
    hats = {name: grids[Station.at(name).kind == "reading"] for name in names}
    products = products_at(evidence, {name: grid.hats for name, grid in hats.items()})
    _find_grams(evidence, hats)
    found = side_by_side(lambda name: _one_station(evidence, name, hats[name], products[name]), names)
    return sorted(found, key=lambda m: -m.gain)


def drifts(evidence: Evidence) -> list[MissingInput]:
    """A latent input at each reading, largest statistic first."""
    return missing_at(evidence, evidence.fit.flight.readings)


def missing_oscillation(evidence: Evidence) -> list[MissingInput]:
    """The clearest oscillation of the innovations as a latent input at each port, largest statistic first.

    Ports at readings are left out. The list is empty if no frequency above those of `missing_inputs` is significant. An
    oscillation is too fast for the nodes of a latent input. Its frequency is that of the highest peak of the
    periodogram of the innovations, pooled over the records. Its amplitude and phase are free in every record.
    """
    frequency = _peak_frequency(evidence.fit)
    if frequency is None:
        return []
    return sorted(_oscillations(evidence, evidence.fit.flight.stations, frequency), key=lambda m: -m.gain)


def _peak_frequency(fit: FlightFit) -> float | None:
    """Frequency [Hz] of the highest peak, if white innovations are very unlikely to have such a peak; else None."""
    numerics = fit.criteria.numerics.missing_input
    significant = fit.criteria.significance.search
    steps = np.array([record.dt for record in fit.flight.records])
    frequency = np.fft.rfftfreq(2 * fit.batch.live.shape[0], steps.min())
    highest = fit.criteria.parts.third  # of the sampling rate
    frequency = frequency[(frequency > 0.5 / numerics.times[0]) & (frequency < highest / steps.min())]
    if not len(frequency):
        return None
    power = np.zeros((len(frequency), len(fit.model.outputs)))
    dof = np.zeros(len(frequency))
    for r, dt in enumerate(steps):
        seen = fit.linear.seen[:, r]
        white = np.where(seen, fit.white[:, r], 0.0)
        nodes = np.fft.rfftfreq(2 * len(white), dt)
        own = 2.0 * np.abs(np.fft.rfft(white, 2 * len(white), axis=0)) ** 2 / np.maximum(seen.sum(axis=0), 1)
        below = frequency < highest / dt
        at = np.clip(np.rint(frequency[below] / nodes[1]).astype(int), 0, len(nodes) - 1)
        power[below] += own[at]  # chi-square, two degrees of freedom
        dof[below] += 2.0
    chance = _log_chance(power, dof[:, None]) + np.log(power.size)
    at, _ = np.unravel_index(np.argmin(chance), chance.shape)
    likely = -0.5 * significant  # log probability that a chi-square variable of two degrees of freedom is larger
    return float(frequency[at]) if chance.min() < likely else None


def _log_chance(power: np.ndarray, dof: np.ndarray) -> np.ndarray:
    """Logarithm of the probability that a chi-square variable is larger.

    Far in the tail, where that is zero in double precision, the leading term of its expansion is used.
    """
    with np.errstate(divide="ignore"):
        near = np.log(special.chdtrc(dof, power))
    half = np.maximum(power, 1.0) / 2.0
    far = (dof / 2.0 - 1.0) * np.log(half) - half - special.gammaln(dof / 2.0)
    return np.where(np.isfinite(near), near, far)


def _oscillations(evidence: Evidence, stations: Sequence[str], frequency: float) -> list[MissingInput]:
    """An oscillation as latent input at each of these ports, whose responses go through the filter side by side."""
    fit = evidence.fit
    ports = [name for name in stations for _ in range(2)]
    many = 2 * len(stations)
    since = fit.batch.t - fit.batch.t[0]
    names = fit.batch.names
    wave = np.stack(_wave(frequency, since), axis=2) * fit.batch.live[..., None]
    grams = np.zeros((len(names), many, many))
    matches = np.zeros((len(names), many))
    crosses = np.zeros((len(names), len(evidence.newton), many))
    for here, own in evidence.in_records():
        white = white_at(own.fit, ports, np.tile(wave[:, here], len(stations)), np.arange(many))
        grams[here] = np.einsum("kryi,kryj->rij", white, white, optimize=True)
        matches[here] = np.einsum("kryi,kry->ri", white, own.fit.white, optimize=True)
        crosses[here] = own.products(white)
    found = []
    for i, station in enumerate(stations):
        at = slice(2 * i, 2 * i + 2)
        gain = 0.0
        history = {}
        sizes = []
        for r, name in enumerate(names):
            left = Projection.of(evidence, grams[r, at, at], matches[r, at], crosses[r, :, at])
            inverse = np.linalg.pinv(left.gram, hermitian=True)
            amplitude = inverse @ left.match
            gain += float(left.match @ amplitude)
            sizes.append(float(np.hypot(*amplitude)))
            t = since[fit.batch.live[:, r], r]
            unit = np.stack(_wave(frequency, t), axis=1)
            sigma = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", unit, inverse, unit), 0.0))
            history[name] = (t + fit.batch.t[0, r], unit @ amplitude, sigma)
        found.append(MissingInput(station=station, gain=gain, size=max(sizes), history=history, frequency=frequency))
    return found


def _wave(frequency: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The two parts of an oscillation whose phase is free."""
    return np.cos(2.0 * np.pi * frequency * t), np.sin(2.0 * np.pi * frequency * t)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Grid:
    """Grid of a latent input."""

    nodes: np.ndarray  # times of the nodes [s]
    hats: np.ndarray  # (N, R, n) contribution of a unit at each node, with straight lines between the nodes
    times: Sequence[float]  # correlation times that are tried [s]


def _grid(evidence: Evidence, slow: bool) -> _Grid:
    """The grid for a reading (`slow`), or for the motion."""
    fit = evidence.fit
    numerics = evidence.criteria.numerics.missing_input
    times = numerics.slow if slow else numerics.quick
    spacing = evidence.criteria.parts.third * times[0] if slow else times[0]
    longest = max(record.duration for record in fit.flight.records)
    spacing = max(spacing, len(fit.flight.records) * longest / numerics.most_nodes)
    nodes = np.arange(0.0, longest + spacing, spacing)
    since = fit.batch.t - fit.batch.t[0]
    hats = np.maximum(0.0, 1.0 - np.abs(since[..., None] - nodes) / spacing)
    return _Grid(nodes=nodes, hats=np.where(fit.batch.live[..., None], hats, 0.0), times=times)


def _find_grams(evidence: Evidence, grids: Mapping[str, _Grid]) -> None:
    """Find the products of the responses at ports that are not in `_grams` yet, a few records at a time."""
    known = _grams(evidence.fit)
    new = [name for name in grids if name not in known]

    def products(here: slice, fit: FlightFit, name: str) -> list[np.ndarray]:
        white = response(fit, name, grids[name].hats[:, here])
        return [gram_of(white[:, r].reshape(-1, white.shape[3])) for r in range(white.shape[1])]

    in_parts = evidence.in_records() if new else ()
    parts = [side_by_side(partial(products, here, own.fit), new) for here, own in in_parts]
    for name, *by_part in zip(new, *parts, strict=True):
        known[name] = np.stack([gram for part in by_part for gram in part])


def _one_station(
    evidence: Evidence, station: str, grid: _Grid, products: tuple[np.ndarray, np.ndarray]
) -> MissingInput:
    """The latent input at one port."""
    left = Projection.by_record(evidence, _grams(evidence.fit)[station], products)
    return _most_likely(evidence, station, grid.nodes, left, grid.times)


def response(fit: FlightFit, station: str, series: np.ndarray) -> np.ndarray:
    """(N, R, ny, k) Whitened response to time histories (N, R, k) at a port."""
    return white_at(fit, [station] * series.shape[2], series, np.arange(series.shape[2]))


def _most_likely(
    evidence: Evidence, station: str, nodes: np.ndarray, left: Projection, times: Sequence[float]
) -> MissingInput:
    """The latent input with the correlation time and variance of the largest marginal likelihood."""
    gram = left.gram
    match = left.match
    R = len(evidence.fit.batch.names)
    best = (0.0, times[0], 0.0)
    ratios = _ratios(evidence.criteria.numerics.missing_input)
    for tau in times:
        root = _prior_root(nodes, tau)
        values, vectors = np.linalg.eigh(_between(gram, root))
        values = np.maximum(values, 0.0)
        power = (vectors.T @ (match.reshape(R, -1) @ root).reshape(-1)) ** 2
        variances = ratios / max(values[-1], 1e-300)
        seen = variances[:, None] * values
        gains = np.sum(variances[:, None] * power / (1.0 + seen), axis=1) - np.sum(np.log1p(seen), axis=1)
        at = int(np.argmax(gains))
        if gains[at] > best[0]:
            best = (float(gains[at]), tau, float(variances[at]))
    gain, tau, variance = best
    history = _history(gram, match, nodes, tau, variance, R)
    inside = {}
    for (mean, sigma), record in zip(history, evidence.fit.flight.records, strict=True):
        here = nodes <= record.duration
        inside[record.name] = record.t[0] + nodes[here], mean[here], sigma[here]
    return MissingInput(station=station, gain=gain, size=float(np.sqrt(variance)), history=inside)


def decades(numerics: MissingInputNumerics) -> np.ndarray:
    """Every power of ten between the smallest and the largest variance that are tried."""
    least, most = numerics.sizes
    return np.geomspace(least, most, 1 + math.ceil(math.log10(most / least)))


def _ratios(numerics: MissingInputNumerics) -> np.ndarray:
    """The variances that are tried, in units of the best-determined direction."""
    least, most = numerics.sizes
    return np.geomspace(least, most, 1 + math.ceil(math.log2(most / least)))  # at least doubled from one to the next


def _prior_root(nodes: np.ndarray, tau: float) -> np.ndarray:
    """Cholesky factor of the prior covariance at the nodes of a record, for unit variance."""
    covariance = np.exp(-np.abs(nodes[:, None] - nodes) / tau) + 1e-9 * np.eye(len(nodes))
    return np.linalg.cholesky(covariance)


def _between(gram: np.ndarray, root: np.ndarray) -> np.ndarray:
    """B' gram B, with the root in every record: B is the block-diagonal matrix of roots."""
    n = len(gram)
    half = gram.reshape(-1, len(root)) @ root
    return (root.T @ half.reshape(-1, len(root), n)).reshape(n, n)


def _history(
    gram: np.ndarray, match: np.ndarray, nodes: np.ndarray, tau: float, variance: float, records: int
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Posterior mean and 1-sigma of the latent input at the nodes, for each record."""
    n = len(nodes)
    if variance <= 0.0:
        return [(np.zeros(n), np.zeros(n)) for _ in range(records)]
    root = np.kron(np.eye(records), np.sqrt(variance) * _prior_root(nodes, tau))
    posterior = root @ np.linalg.inv(np.eye(records * n) + root.T @ gram @ root) @ root.T
    # rounding may leave a negative variance
    mean = posterior @ match
    sigma = np.sqrt(np.maximum(np.diag(posterior), 0.0))
    return [(mean[r * n : (r + 1) * n], sigma[r * n : (r + 1) * n]) for r in range(records)]
