"""Explanations grown from one background: causes added one by one, dropped, and swapped for others."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cached_property

import numpy as np

from casid.diagnosis.explanations.explanation import Element, Explanation, Setting, Unknown
from casid.diagnosis.explanations.prior import Priors
from casid.diagnosis.explanations.score import Background, Loosened, gain

_Key = tuple[int, tuple[int, ...]]  # number of the loosened history, -1 for none, and of the entries


class _State:
    """Causes and a loosened history in the model: what K and z have lost, U'U and U'u, log evidence and log prior."""

    def __init__(self, key: _Key, U: np.ndarray, u: np.ndarray, log: float, prior: float) -> None:
        self.key, self.U, self.u, self.log, self.prior = key, U, u, log, prior


class Growth:
    """All explanations on one background."""

    def __init__(
        self, back: Background, priors: Priors, large: Mapping[Unknown, float], among: Collection[str] | None
    ) -> None:
        self.back, self.priors, self.large, self.causes = back, priors, large, back.sums.innovations.causes
        entries = [(i, s) for i, cause in enumerate(self.causes) for s in cause.scales]
        self.column = np.array([i for i, _ in entries], dtype=int)
        self.scale = np.array([s for _, s in entries], dtype=float)
        self.mean = np.array([self.causes[i].mean for i in self.column])
        self.prior = np.array([self.causes[i].log_prior - np.log(len(self.causes[i].scales)) for i in self.column])
        names = {name: n for n, name in enumerate(dict.fromkeys(cause.name for cause in self.causes))}
        self.name = np.array([names[self.causes[i].name] for i in self.column], dtype=int)
        self.diagonal = np.diag(back.K)
        self.starts = np.flatnonzero(np.diff(self.column, prepend=-1)) if len(entries) else np.zeros(0, dtype=int)
        self.ends = np.append(self.starts[1:], len(entries))
        self.top, self.among = -np.inf, among
        self.promises: dict[str, float] = {}
        self.found: dict[_Key, tuple[float, float]] = {}
        self.expanded: set[_Key] = set()

    @cached_property
    def options(self) -> list[Loosened]:
        """Histories that may be loosened beside those of the background, of entrances that promised anything before."""
        there = {name for name, _, _ in self.back.loose}
        entrances = [e for e in self.back.sums.innovations.entrances if e.name not in there]
        entrances = [e for e in entrances if self.among is None or e.name in self.among]
        return [option for entrance in entrances for option in self.back.loosened(entrance, self.priors)]

    @property
    def setting(self) -> Setting:
        return self.back.setting

    def run(self, known: Sequence[Sequence[Element]]) -> list[Explanation]:
        """The explanations that count: grown from nothing, or from those `known` from another setting."""
        self._note(self._state((-1, ())))
        at = {(int(c), float(s)): e for e, (c, s) in enumerate(zip(self.column, self.scale, strict=True))}
        if known:
            keys = {(-1, tuple(sorted(at[e.column, e.scale] for e in elements))) for elements in known}
            for key in sorted(keys):
                self._note(self._state(key))
            self._grow(self._entrances(max(keys, key=lambda key: sum(self.found[key]))))
        else:
            self._grow([self._state((-1, ()))])
            self._grow(self._entrances((-1, ())))
        self._swapped()
        return [self._explanation(key) for key, (log, prior) in self.found.items() if self._counts(log + prior)]

    def _counts(self, total: float) -> bool:
        return total > self.top - self.priors.numerics.negligible

    def _note(self, state: _State) -> None:
        self.found[state.key] = state.log, state.prior
        self.top = max(self.top, state.log + state.prior)

    def _entrances(self, causes: _Key) -> list[_State]:
        """The best loosened histories, by themselves or with the one cause that adds most, and beside the causes that
        are known to be best."""
        promise, most = [], self.priors.numerics.entrances
        for i, option in enumerate(self.options):
            self.found[i, ()] = option.log, option.log_prior
            self.top = max(self.top, option.log + option.log_prior)
            z = self.back.z - option.f.T @ (option.d * option.a)
            K = self.diagonal - option.d @ option.f**2
            more = max(0.0, float(np.max(self._gains(z, K), initial=0.0)))
            promise.append((option.log + option.log_prior + more, i))
            self._promised(option, promise[-1][0])
        states = [self._state((i, ())) for _, i in sorted(promise, reverse=True)[:most]]
        if causes[1]:
            both = [self._state((i, causes[1])) for i in range(len(self.options))]
            for state in both:
                self._note(state)
                self._promised(self.options[state.key[0]], state.log + state.prior)
            states += sorted(both, key=lambda state: -(state.log + state.prior))[:most]
        return states

    def _promised(self, option: Loosened, total: float) -> None:
        name = option.unknown[0]
        self.promises[name] = max(total, self.promises.get(name, -np.inf))

    @property
    def hopeful(self) -> frozenset[str]:
        """Entrances at which something unknown is not out of the question, here or at other settings."""
        nothing = max(sum(weight) for (_, entries), weight in self.found.items() if not entries)
        numerics = self.priors.numerics
        within = numerics.negligible + max(numerics.near, numerics.linear * (self.top - nothing))
        return frozenset(name for name, total in self.promises.items() if total > self.top - within)

    def _gains(self, z: np.ndarray, K: np.ndarray) -> np.ndarray:
        at = self.column
        return gain(z[at], np.maximum(K, 0.0)[at], self.mean, self.scale) + self.prior

    def _state(self, key: _Key) -> _State:
        option, entries = key
        U, u, log, prior = np.zeros((0, len(self.causes))), np.zeros(0), 0.0, 0.0
        if option >= 0:
            one = self.options[option]
            (U, u), log, prior = one.update, one.log, one.log_prior
        state = _State((option, ()), U, u, log, prior)
        for entry in entries:
            state = self._with(state, entry)
        return state

    def _with(self, state: _State, entry: int) -> _State:
        j, s, mean = self.column[entry], self.scale[entry], self.mean[entry]
        row = self.back.K[j] - state.U[:, j] @ state.U
        z = self.back.z[j] - state.u @ state.U[:, j]
        q = 1.0 + s * s * row[j]
        more = gain(z, row[j], mean, s)
        return _State(
            (state.key[0], tuple(sorted((*state.key[1], entry)))),
            np.vstack([state.U, row * (s / np.sqrt(q))]),
            np.append(state.u, (s * s * z + mean) / (s * np.sqrt(q))),
            state.log + float(more),
            state.prior + float(self.prior[entry]),
        )

    def _children(self, state: _State) -> list[tuple[float, _Key]]:
        """All explanations with one cause more that are not negligible, noted; of each column the best scale."""
        option, entries = state.key
        self.expanded.add(state.key)
        if not len(self.column) or len(entries) >= self.priors.numerics.causes:
            return []
        more = self._gains(self.back.z - state.U.T @ state.u, self.diagonal - np.einsum("ij,ij->j", state.U, state.U))
        taken = np.isin(self.name, self.name[list(entries)])
        totals = np.where(taken, -np.inf, state.log + state.prior + more)
        self.top = max(self.top, float(totals.max()))
        counts = np.flatnonzero(totals > self.top - self.priors.numerics.negligible)
        noted = counts[np.argsort(-totals[counts], kind="stable")][: self.priors.numerics.noted]
        for entry in noted.tolist() or [int(np.argmax(totals))]:
            if np.isfinite(totals[entry]):
                log = float(state.log + more[entry] - self.prior[entry])
                self.found[option, tuple(sorted((*entries, entry)))] = log, float(state.prior + self.prior[entry])
        best = np.maximum.reduceat(totals, self.starts)  # of every column
        columns = np.argsort(-best, kind="stable")[: self.priors.numerics.beam]
        first = [self.starts[c] + int(np.argmax(totals[self.starts[c] : self.ends[c]])) for c in columns]
        return [
            (float(totals[e]), (option, tuple(sorted((*entries, int(e)))))) for e in first if np.isfinite(totals[e])
        ]

    def _grow(self, states: Iterable[_State]) -> None:
        """Causes added one by one, the best explanations of each number kept."""
        states, before, numerics = list(states), -np.inf, self.priors.numerics
        for number in range(1, numerics.causes + 1):
            children: dict[object, tuple[float, _Key]] = {}
            for state in states:
                for total, key in self._children(state):
                    alike = key[0], tuple(sorted(int(self.column[e]) for e in key[1]))
                    if alike not in children or total > children[alike][0]:
                        children[alike] = total, key
            best = sorted(children.values(), key=lambda child: -child[0])[: numerics.beam]
            if not best or (number > numerics.pairs and best[0][0] < before):
                return
            states, before = [self._state(key) for _, key in best], best[0][0]

    def _swapped(self) -> None:
        """Causes of the best explanations dropped, and others put in their place, while that finds better ones."""
        for _ in range(self.priors.numerics.causes):
            ranked = sorted(self.found, key=lambda key: -sum(self.found[key]))[: self.priors.numerics.changed]
            fewer = {
                (option, entries[:i] + entries[i + 1 :]) for option, entries in ranked for i in range(len(entries))
            }
            todo = sorted((fewer | set(ranked)) - self.expanded)
            if not todo:
                return
            for key in todo:
                state = self._state(key)
                self._note(state)
                self._children(state)

    @property
    def nothing(self) -> float:
        """Log weight of the best explanation without any cause."""
        bare = max(sum(weight) for (_, entries), weight in self.found.items() if not entries)
        return self.back.log + self.back.log_prior + bare

    def without(self) -> dict[str, Explanation]:
        """Name of a cause that counts -> the best explanation without it."""
        ranked = sorted(((sum(weight), key) for key, weight in self.found.items()), reverse=True)
        names = {int(self.name[e]) for total, (_, entries) in ranked if self._counts(total) for e in entries}
        found = {}
        for name in sorted(names):
            key = next(key for _, key in ranked if name not in self.name[list(key[1])])
            found[self.causes[int(self.column[np.argmax(self.name == name)])].name] = self._explanation(key)
        return found

    def _explanation(self, key: _Key) -> Explanation:
        option, entries = key
        log, prior = self.found[key]
        columns, scale = self.column[list(entries)], self.scale[list(entries)]
        K, z = self.back.K[np.ix_(columns, columns)], self.back.z[columns]
        large = {unknown: self.large.get(unknown, float(unknown[1] >= 1.0)) for unknown in self.back.loose}
        loosened = self.options[option] if option >= 0 else None
        if loosened is not None:
            U, u = loosened.update
            K, z = K - U[:, columns].T @ U[:, columns], z - u @ U[:, columns]
        spread = np.linalg.inv(K + np.diag(scale**-2.0))
        sizes = spread @ (z + self.mean[list(entries)] / scale**2)
        if loosened is not None:
            large[loosened.unknown] = loosened.as_large_as_matters(columns.tolist(), sizes)
        unknown = tuple(sorted(large))
        names = {self.causes[c].name for c in columns} | {one[0] for one, p in large.items() if p > 0.5}
        return Explanation(
            setting=self.back.setting,
            unknown=unknown,
            elements=tuple(Element(column=int(c), scale=float(s)) for c, s in zip(columns, scale, strict=True)),
            amplitudes=tuple(zip(sizes.tolist(), np.sqrt(np.diag(spread)).tolist(), strict=True)),
            large=tuple(large[one] for one in unknown),
            names=frozenset(names),
            log=self.back.log + self.back.log_prior + log + prior,
            evidence=self.back.log + log,
        )
