"""A model with causes in it: in symbols, with what its records need, and fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from casid.diagnosis.systems.cause import PartOfModel
from casid.model.system import Model
from casid.records.record import Record


class Draft:
    """A model under change. Expressions that are added are in the symbols of the model at its beginning. `current` is
    the cause that changes it and `rest` the symbol of its channel of that name, `delayed` its readings that are late:
    before that, and by the series of `late`."""

    current, rest = "", ca.SX(0.0)

    def __init__(self, model: Model, shortest: float, sizes: Mapping[str, float]) -> None:
        self.model, self.shortest, self.sizes = model, shortest, sizes
        self.f, self.h = ca.SX(model.f), ca.SX(model.h)
        self.p, self.u = ca.SX(model.p), ca.SX(model.u)
        self.delayed: dict[str, tuple[ca.SX, ca.SX]] = {}
        self.states: list[tuple[str, ca.SX, ca.SX, str | None, float]] = []

    def adds(self, state: str, expression: Any) -> None:
        """A term in the equation of a state."""
        self.f[self.model.states.index(state)] += expression

    def shifts(self, parameter: str, by: Any) -> None:
        """A parameter that differs from its value by an expression."""
        self.p[self.model.parameters.index(parameter)] += by

    def drives(self, name: str, by: Any) -> None:
        """An input that acts with something added to it."""
        self.u[self.model.inputs.index(name)] += by

    def reads(self, output: str, change: Callable[[Any], Any]) -> None:
        """A reading that an instrument changes."""
        i = self.model.outputs.index(output)
        self.h[i] = change(self.h[i])

    def lagged(self, output: str, time: Any) -> None:
        """A reading behind a first-order lag."""
        i, state = self.model.outputs.index(output), ca.SX.sym("lagged")
        rate = (self.h[i] - state) / ca.fmax(ca.fabs(time), self.shortest)
        self.states.append((f"lagged[{output}]", state, rate, output, self.sizes[output]))
        self.h[i] = state

    def late(self, output: str, time: Any) -> None:
        """A delayed reading: two terms of Taylor's series, and what these leave along the motion, from the record."""
        i = self.model.outputs.index(output)
        y = self.h[i]
        rate = ca.jtimes(y, self.model.x, self.model.f)
        series = y - time * rate + time**2 / 2.0 * ca.jtimes(rate, self.model.x, self.model.f)
        self.delayed[self.current] = y, series
        self.h[i] = series + self.rest


@dataclass(frozen=True, eq=False, kw_only=True)
class Extended:
    """A model with causes in it; `base` without them; `sizes` typical of each output, `shortest` time [s] of a lag.

    paths  record -> (N, states) motion of the base model from which a fit begins; else its own first guess
    Its records are `prepared` first: they carry inputs as operators leave them, and where a cause is there.
    """

    base: Model
    attached: tuple[PartOfModel, ...] = ()
    sizes: Mapping[str, float]
    shortest: float
    paths: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def model(self) -> Model:
        """The extended model: a parameter for every cause, a priori at its centre."""
        return self._built[0]

    @cached_property
    def _built(self) -> tuple[Model, dict[str, ca.Function]]:
        """The model, and of each delayed reading (x, u, p) -> the reading before that, and by the series."""
        base, draft = self.base, Draft(self.base, self.shortest, self.sizes)
        values = {one.name: ca.SX.sym("value") for one in self.attached}
        channels = [c for one in self.attached for c in one.channels]
        symbols = {name: ca.SX.sym("channel") for name in channels}
        for one in self.attached:
            value, flag = values[one.name], symbols[one.flag] if one.flag else 1.0
            draft.current, draft.rest = one.name, symbols.get(one.rest or "", ca.SX(0.0))
            if one.cause.operator is not None:
                draft.drives(one.cause.target, value * symbols[str(one.slope)])
            elif one.cause.change is not None:
                one.cause.change(draft, value, flag)
        states = draft.states
        rates = ca.vertcat(draft.f, *[rate for _, _, rate, _, _ in states])
        late = [ca.vertcat(*pair) for pair in draft.delayed.values()]
        f, h, *late = ca.substitute([rates, draft.h, *late], [base.p, base.u], [draft.p, draft.u])
        x = ca.vertcat(base.x, *[symbol for _, symbol, *_ in states])
        u, p = ca.vertcat(base.u, *symbols.values()), ca.vertcat(base.p, *values.values())
        model = replace(
            base,
            states=(*base.states, *(name for name, *_ in states)),
            inputs=(*base.inputs, *channels),
            parameters=(*base.parameters, *values),
            x=x,
            u=u,
            p=p,
            f=f,
            h=h,
            nominal={**base.nominal, **{one.name: one.centre for one in self.attached}},
            prior_std={**base.prior_std, **{one.name: one.spread for one in self.attached}},
            state_scale={**base.state_scale, **{name: size for name, _, _, _, size in states}},
            guess=_guess(base, self.paths, [(source, size) for _, _, _, source, size in states]),
            units={**base.units, **{one.name: one.cause.unit for one in self.attached}},
            equation=None,
        )
        return model, {
            name: ca.Function("late", [x, u, p], [pair]) for name, pair in zip(draft.delayed, late, strict=True)
        }

    def along(self, motions: Mapping[str, np.ndarray], records: Sequence[Record], p: np.ndarray) -> Extended:
        """The same with what the series of delayed readings leave along a motion (N, states) of each prepared record,
        and parameters `p` of the model."""
        model, late = self._built
        attached = []
        for one in self.attached:
            if one.name in late:
                delay, left = p[model.parameters.index(one.name)], dict(one.left)
                for record in records:
                    pair = late[one.name](motions[record.name].T, record.matrix(model.inputs).T, p).full()
                    exact = CubicSpline(record.t, pair[0])(np.maximum(record.t - delay, record.t[0]))
                    left[record.name] = np.where(record.t - delay >= record.t[0], exact - pair[1], 0.0)
                one = replace(one, left=left)
            attached.append(one)
        return replace(self, attached=tuple(attached))

    def prepared(self, record: Record) -> Record:
        """The record with what the extended model needs of it."""
        for one in self.attached:
            record = one.prepared(record)
        return record

    def with_cause(self, one: PartOfModel) -> Extended:
        """The same with one cause more."""
        return replace(self, attached=(*self.attached, one))

    def without(self, name: str) -> Extended:
        """The same without a cause."""
        return replace(self, attached=tuple(one for one in self.attached if one.name != name))


def _guess(
    base: Model, paths: Mapping[str, np.ndarray], sources: Sequence[tuple[str | None, float]]
) -> Callable[[Record], np.ndarray]:
    """First guess of the states: along paths where they are known, those of an instrument as it read."""

    def guess(record: Record) -> np.ndarray:
        columns = [paths[record.name] if record.name in paths else base.guess(record)]
        for source, _ in sources:
            values = np.zeros(len(record))
            if source is not None and source in record:
                good = np.isfinite(record[source])
                if good.any():
                    values = np.interp(record.t, record.t[good], record[source][good])
            columns.append(values[:, None])
        return np.concatenate(columns, axis=1)

    return guess
