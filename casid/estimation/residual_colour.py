"""Colour of the residuals: an autoregression per channel, and the score covariance that it gives.

A fit takes from its residuals what its parameters can follow, just where the sensitivities have their power, so that
the residuals' own autocovariance promises too much. The noise n = r - X d behind residuals r of sensitivities X has,
for a given autoregression, the expected autocovariance sums

    E[sum_i n_i n_(i+k)] = sum_i s_i s_(i+k) + trace(I^-1 sum_i x_i x_(i+k)'),    s = r - X I^-1 X' R^-1 r,

with the information I = X' R^-1 X + prior; the next autoregression follows from them by the recursion of Levinson and
Durbin. This is expectation and maximisation of the restricted likelihood (Patterson and Thompson, Biometrika 58, 1971;
Cheang and Reinsel, JASA 95, 2000). For white noise it divides the sum of squares by samples less parameters. The order
is that of least AIC. Initial states, which take few degrees of freedom and only at the start, are not counted.

What is left is the bias of an autoregression of few samples: its poles come out too far from the unit circle, and slow
noise too weak. That of least squares is taken off at the end; taken off in every round, it would feed on itself where
parameters follow slow noise.

The slow noise that cannot be separated from parameters may lie far below white noise when it is sampled fast. Therefore
the autoregression is that of the means of blocks of samples, as long as the sensitivities stay the same within a block;
what is left within the blocks counts as white.

The variances that follow have little bias, and scatter as the autoregression does. Intervals allow for that by the
quantiles of Student's distribution, see `variance_scatter`.

Everything is gathered from pieces of records, one record after the other and each in the order of time. No more of
them is kept than the last few rows; sums are those of all records with the same parameters together.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby

import numpy as np
import scipy

from casid.estimation.solvers.quadratic import inverse_along

ORDER = 12  # highest of the autoregression: the lags that are gathered
_SAMPLES_PER_ORDER = 10
BLOCKS = (1, 2, 4, 8)  # samples per block that are tried
_KEPT = 0.97  # of the sums of squares of the sensitivities that the means of the blocks must keep
_ROUNDS = 2  # of expectation and maximisation: what more would change is below one per cent of a standard deviation
_CHUNK = 1024  # samples per product of matrices: they stay in the cache
_PREDICTED = 1e-12  # of the variance: what an autoregression leaves of residuals without noise
_LEAST = 1e-16  # variance of weighted residuals that is rounding


@dataclass(frozen=True, eq=False, kw_only=True)
class WhitePiece:
    """Consecutive samples of one channel in one record, those that are missing left out: weighted sensitivities
    rows (m, f) to the parameters `columns`, weighted residuals (m,)."""

    channel: int
    record: int
    columns: np.ndarray
    rows: np.ndarray
    residuals: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class Colour:
    """Autoregression sum_j a_j n_(i-j) = e_i of the noise, a_0 = 1, with the variance of e."""

    a: np.ndarray
    variance: float

    @property
    def white(self) -> bool:
        """Return True if a sample does not predict the next."""
        return len(self.a) == 1

    @cached_property
    def ringing(self) -> np.ndarray:
        """(order, order) sum of squares of all that follows the last values of 1/A, newest first, without input."""
        follow = np.eye(len(self.a) - 1, k=-1)
        follow[0] = -self.a[1:]
        # sum over k >= 1 of the squares of the first state of follow^k
        return scipy.linalg.solve_discrete_lyapunov(follow.T, follow[:1].T @ follow[:1])


def gathered(pieces: Iterable[WhitePiece]) -> dict[int, ChannelSums]:
    """Channel -> its sums, of pieces of one record after the other, each in the order of time."""
    found: dict[int, ChannelSums] = {}
    for piece in pieces:
        found.setdefault(piece.channel, ChannelSums()).add(piece)
    return found


def coloured_score(
    colours: Mapping[int, Colour], sums: Mapping[int, ChannelSums], pieces: Iterable[WhitePiece], count: int
) -> np.ndarray:
    """(count, count) covariance of the gradient of 1/2 sum of squared residuals in the `count` parameters: sum of
    X' R X over channels. `sums` are those of the pieces, `colours` those of their blocks."""
    total = np.zeros((count, count))
    for c, own in sums.items():
        within = own.variance_within
        spread(total, own.gram(within))
        spread(total, own.inner(np.array([colours[c].variance if colours[c].white else 0.0]) - within))
    if all(colour.white for colour in colours.values()):
        return total
    for _, of_record in groupby(pieces, key=lambda piece: piece.record):
        running: dict[int, tuple[_Blocks, _Filter]] = {}
        for piece in of_record:
            c = piece.channel
            if colours[c].white:
                continue
            if c not in running:
                running[c] = _Blocks(sums[c].block, len(piece.columns)), _Filter(colours[c], piece.columns)
            blocks, run = running[c]
            run.add(blocks.add(piece.rows))
        for _, run in running.values():
            run.spread(total)
    return total


def variance_scatter(
    colours: Mapping[int, Colour],
    sums: Mapping[int, ChannelSums],
    pieces: Iterable[WhitePiece],
    inverse: np.ndarray,
) -> np.ndarray:
    """(count,) variance of the diagonal of `inverse` S `inverse`, S as of `coloured_score`, because the autoregressions
    are estimated.

    The coefficients of a channel scatter with the covariance variance G^-1 / N, with the autocovariance G of the noise
    in as many lags, and the variance by its double square over N (Brockwell and Davis, Time Series, 1991, ch. 8).
    """
    total = np.zeros(len(inverse))
    running = {c: _Scatter(colours[c], own, inverse) for c, own in sums.items()}
    for piece in pieces:
        running[piece.channel].add(piece)
    for own in running.values():
        total += own.variance()
    return total


class _Scatter:
    """Variance of one channel that `variance_scatter` is the sum of. With u = X `inverse`_i of parameter i and v =
    u/A its part is variance sum v^2, and the slope of that in a_j is -2 variance sum v_k (v/A)_(k-j)."""

    def __init__(self, colour: Colour, own: ChannelSums, inverse: np.ndarray) -> None:
        self.colour = colour
        self.own = own
        self.inverse = inverse
        self.record = -1
        self.squares, self.slopes = np.zeros(len(inverse)), np.zeros((len(colour.a) - 1, len(inverse)))

    def add(self, piece: WhitePiece) -> None:
        if piece.record != self.record:
            self._ring()
            self.record = piece.record
            self._rows = 0
            self._blocks = _Blocks(self.own.block, len(piece.columns))
            self._once, self._twice, self._last = (np.zeros_like(self.slopes) for _ in range(3))
        self._along(self._blocks.add(piece.rows) @ self.inverse[piece.columns])

    def _along(self, u: np.ndarray) -> None:
        a = self.colour.a
        order = len(self.slopes)
        self._rows += len(u)
        once = u
        if order:
            once, self._once = _through(a, u, self._once)
            twice, self._twice = _through(a, once, self._twice)
            both = np.concatenate([self._last, twice])
            for j in range(1, order + 1):
                self.slopes[j - 1] += (once * both[order - j : order - j + len(u)]).sum(axis=0)
            self._last = both[-order:]
        self.squares += (once**2).sum(axis=0)

    def _ring(self) -> None:
        """Add what follows the last sample of a record, for as long as the record was itself."""
        if self.record >= 0 and len(self.slopes):
            self._along(np.zeros((self._rows, len(self.inverse))))

    def variance(self) -> np.ndarray:
        self._ring()
        order = len(self.slopes)
        variance = self.colour.variance
        count = self.own.count
        found = 2.0 * (variance * self.squares) ** 2 / count
        if order:
            follow = np.eye(order, k=-1)
            first = np.zeros((order, order))
            follow[0] = -self.colour.a[1:]
            first[0, 0] = variance
            autocovariance = scipy.linalg.solve_discrete_lyapunov(follow, first)
            slopes = -2.0 * variance * self.slopes
            found += (slopes * np.linalg.solve(autocovariance, slopes)).sum(axis=0) * variance / count
        return found


class _Blocks:
    """Sums over blocks of `size` rows of a stream (m, width), over the root of the size, so that white noise keeps its
    variance; what does not fill a block waits for more."""

    def __init__(self, size: int, width: int) -> None:
        self._size = size
        self._width = width
        self.restart()

    def restart(self) -> None:
        """A new record follows."""
        self._waiting = np.zeros((0, self._width))

    def add(self, rows: np.ndarray) -> np.ndarray:
        """(blocks, width) that are complete now."""
        if self._size == 1:
            return rows
        both = np.concatenate([self._waiting, rows])
        full = len(both) // self._size * self._size
        self._waiting = both[full:]
        return both[:full].reshape(-1, self._size, both.shape[1]).sum(axis=1) / math.sqrt(self._size)


class _Lagged:
    """Sums of rows_(i-k) rows_i' of streams (m, width) for the lags k, and the number of rows."""

    def __init__(self, width: int) -> None:
        self.sums = np.zeros((ORDER + 1, width, width))
        self.count = 0
        self.restart()

    def restart(self) -> None:
        """A new record follows."""
        self._last = np.zeros((ORDER, self.sums.shape[1]))

    def add(self, rows: np.ndarray) -> None:
        both = np.concatenate([self._last, rows])
        for start in range(0, len(rows), _CHUNK):
            part = rows[start : start + _CHUNK]
            for k in range(ORDER + 1):
                behind = start + ORDER - k
                self.sums[k] += both[behind : behind + len(part)].T @ part
        self._last = both[-ORDER:]
        self.count += len(rows)


Product = tuple[np.ndarray, np.ndarray]  # columns (f,), and a matrix (f+1, f+1) of those parameters and the residuals


def spread(total: np.ndarray, products: list[Product]) -> np.ndarray:
    """Add the parameters' part of the products to `total` (parameters, parameters), which is returned."""
    for columns, matrix in products:
        total[np.ix_(columns, columns)] += matrix[:-1, :-1]
    return total


class ChannelSums:
    """Lagged sums of [x; r] of one channel over all records with the same parameters, for every size of block."""

    def __init__(self) -> None:
        self._columns: dict[bytes, np.ndarray] = {}
        self._streams: dict[bytes, list[tuple[_Blocks, _Lagged]]] = {}
        self._squares: dict[int, np.ndarray] = {}  # record -> (sizes of block, width) sums

    def add(self, piece: WhitePiece) -> None:
        own = np.column_stack([piece.rows, piece.residuals])
        key = piece.columns.tobytes()
        width = own.shape[1]
        if key not in self._streams:
            self._columns[key] = piece.columns
            self._streams[key] = [(_Blocks(size, width), _Lagged(width)) for size in BLOCKS]
        if piece.record not in self._squares:
            self._squares[piece.record] = np.zeros((len(BLOCKS), width))
            for blocks, lagged in self._streams[key]:
                blocks.restart()
                lagged.restart()
        for (blocks, lagged), squares in zip(self._streams[key], self._squares[piece.record], strict=True):
            rows = blocks.add(own)
            lagged.add(rows)
            squares += np.einsum("ij,ij->j", rows, rows)

    @cached_property
    def _level(self) -> int:
        """Which size of block is used; once all pieces are there."""
        for level in reversed(range(1, len(BLOCKS))):
            if self._count(level) >= _SAMPLES_PER_ORDER * ORDER and self._kept(level) >= _KEPT:
                return level
        return 0

    def _count(self, level: int) -> int:
        return sum(streams[level][1].count for streams in self._streams.values())

    def _kept(self, level: int) -> float:
        """Least share of a sensitivity's sum of squares in a record that is in the means of the blocks."""
        least = 1.0
        for squares in self._squares.values():
            whole = squares[0, :-1]
            means = squares[level, :-1]
            seen = whole > 0.0
            least = min(least, float((means[seen] / whole[seen]).min(initial=1.0)))
        return least

    @property
    def block(self) -> int:
        """Samples per block."""
        return BLOCKS[self._level]

    @property
    def count(self) -> int:
        """Number of blocks."""
        return self._count(self._level)

    @property
    def variance_within(self) -> float:
        """Return the variance of the residuals about the means of their blocks."""
        if self._level == 0:
            return 0.0
        whole, means = (sum(squares[i, -1] for squares in self._squares.values()) for i in (0, self._level))
        return max(float(whole - means), 0.0) / (self._count(0) - self.count)

    def gram(self, factor: float) -> list[Product]:
        """`factor` times the sum over all samples of [x; r] [x; r]'."""
        return [(self._columns[key], factor * streams[0][1].sums[0]) for key, streams in self._streams.items()]

    def inner(self, weights: np.ndarray) -> list[Product]:
        """Sum over the lags, both ways, of the sums over blocks times `weights` (lags,)."""
        found = []
        for key, streams in self._streams.items():
            lagged = streams[self._level][1].sums
            one_way = np.tensordot(weights[1:], lagged[1 : len(weights)], 1)
            found.append((self._columns[key], weights[0] * lagged[0] + one_way + one_way.T))
        return found

    def autocovariance(self, shift: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """(lags,) expected, of the noise of the blocks, for parameters off by `shift` with `covariance`."""
        found = np.zeros(ORDER + 1)
        for key, streams in self._streams.items():
            columns = self._columns[key]
            lagged = streams[self._level][1].sums
            off = np.append(-shift[columns], 1.0)
            found += lagged @ off @ off
            found += np.tensordot(lagged[:, :-1, :-1], covariance[np.ix_(columns, columns)], 2)
        return found / self.count


def noise_autocovariance(sums: Mapping[int, ChannelSums], prior: np.ndarray, free: np.ndarray) -> dict[int, np.ndarray]:
    """Channel -> (lags,) autocovariance of the noise behind its residuals, of blocks.

    prior   (parameters, parameters) information besides the data's
    free    (parameters, directions) in which the parameters can move
    """
    unmoved = np.zeros(len(prior))
    exact = np.zeros_like(prior)
    found = {c: own.autocovariance(unmoved, exact) for c, own in sums.items()}
    for _ in range(_ROUNDS):
        information = prior.copy()
        gradient = np.zeros(len(prior))
        for c, own in sums.items():
            colour = autoregression(found[c], own.count)
            both_ways = np.correlate(colour.a, colour.a, "full")[len(colour.a) - 1 :]
            inner = own.inner(both_ways / max(colour.variance, _LEAST))
            spread(information, inner)
            for columns, matrix in inner:
                gradient[columns] += matrix[:-1, -1]
        covariance = inverse_along(free, information)
        shift = covariance @ gradient
        found = {c: own.autocovariance(shift, covariance) for c, own in sums.items()}
    return found


def autoregression(autocovariance: np.ndarray, count: int) -> Colour:
    """The autoregression of least AIC for an autocovariance (lags,) of `count` samples, by Levinson and Durbin."""
    size = min(len(autocovariance) - 1, count // _SAMPLES_PER_ORDER)
    c = autocovariance.tolist()
    a = [1.0]
    variance = c[0]
    best = ([1.0], max(c[0], 0.0))
    least = math.inf
    for order in range(size + 1):
        if order:
            reflection = -sum(a[j] * c[order - j] for j in range(order)) / variance
            a = [left + reflection * right for left, right in zip([*a, 0.0], [0.0, *a[::-1]], strict=True)]
            variance *= 1.0 - reflection**2
        if not variance > _PREDICTED * c[0]:
            break
        criterion = count * math.log(variance) + 2 * order
        if criterion < least:
            best = (a, variance)
            least = criterion
    return Colour(a=np.array(best[0]), variance=best[1])


def gain(autocovariance: np.ndarray, count: int) -> float:
    """Twice the gain in ln(likelihood) of `autoregression` over white noise."""
    whole = max(float(autocovariance[0]), 0.0)
    left = autoregression(autocovariance, count).variance
    return count * math.log(whole / left) if left > 0.0 else 0.0


def estimated(autocovariance: np.ndarray, count: int) -> Colour:
    """`autoregression` of an autocovariance (lags,) that comes from `count` samples, less its bias to first order.

    The bias of least squares is linear in the coefficients (Shaman and Stine, JASA 83, 1988; the same numbers as Pope,
    J. Time Ser. Anal. 11, 1990, without a mean). Count times that of a_j is -j a_j, plus the a_k with k < j, minus
    those with k > order - j. Both for the k that differ from j by an even number. That of the equations of Yule and
    Walker is greater, by an amount that depends on the poles. As much of it is taken off as leaves the noise stationary
    (Kilian, Rev. Econ. Stat. 80, 1998).
    """
    raw = autoregression(autocovariance, count)
    order = len(raw.a) - 1
    j, k = np.ogrid[: order + 1, : order + 1]
    slope = ((k - j) % 2 == 0) * ((k < j).astype(float) - (k > order - j)) - np.diag(np.arange(order + 1.0))
    slope[0] = 0.0  # a_0 is one
    bias = slope @ raw.a / count
    share = next((s for s in 0.5 ** np.arange(10) if _stationary(raw.a - s * bias)), 0.0)
    return Colour(a=raw.a - share * bias, variance=raw.variance * count / (count - order))


def _stationary(a: np.ndarray) -> bool:
    """Return True if an autoregression has all reflection coefficients below one, by the recursion of Levinson
    backwards."""
    while len(a) > 1:
        reflection = a[-1]
        if not abs(reflection) < 1.0:
            return False
        a = (a[:-1] - reflection * a[:0:-1]) / (1.0 - reflection**2)
    return True


def _through(a: np.ndarray, rows: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows run through 1/A, and the state of the filter after them. scipy leaves that of no rows unset."""
    return scipy.signal.lfilter([1.0], a, rows, axis=0, zi=state) if len(rows) else (rows, state)


class _Filter:
    """X' R X of one channel and record: R = variance (A' A)^-1 with the filter A of the autoregression. So it is the
    Gram matrix of the rows run through 1/A, also of what rings on after the last."""

    def __init__(self, colour: Colour, columns: np.ndarray) -> None:
        self.colour = colour
        self.columns = columns
        order = len(colour.a) - 1
        width = len(columns)
        self._memory = np.zeros((order, width))
        self._recent = np.zeros((order, width))
        self._gram = np.zeros((width, width))

    def add(self, rows: np.ndarray) -> None:
        run, self._memory = _through(self.colour.a, rows, self._memory)
        self._gram += run.T @ run
        self._recent = np.concatenate([self._recent, run])[-len(self._recent) :]

    def spread(self, total: np.ndarray) -> None:
        """Add it to `total` (parameters, parameters)."""
        newest_first = self._recent[::-1]
        score = self.colour.variance * (self._gram + newest_first.T @ self.colour.ringing @ newest_first)
        total[np.ix_(self.columns, self.columns)] += score
