"""Find what a fit's data can separate, in words: weak directions of the information, what moved, what the prior did.

The information of the parameters, priors left out and initial states eliminated, is scaled to a unit diagonal, so that
its eigenvalues measure collinearity alone (Belsley, Kuh and Welsch, Regression Diagnostics, 1980, ch. 3; Klein and
Morelli, Aircraft System Identification, 2006, ch. 5): condition index = largest over own singular value.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casid.analysis.excitation import Excitation, Suggestion, best_manoeuvre, candidates, excitations
from casid.analysis.relinearise import relinearise
from casid.arguments import require
from casid.errors import check_known
from casid.estimation.fit import Fit
from casid.estimation.solvers.identified import determined
from casid.estimation.transcriptions.transcription import MultipleShooting
from casid.frames import Rows, brief
from casid.model.system import Model, bare_name
from casid.native.singular import singular_is
from casid.native.threads import single_threaded

_DEFAULT_METHOD = MultipleShooting()
# condition index from which collinearity is worth a word, and is strong (Belsley)
_INDEX = 10.0
_STRONG = 30.0
_PROPORTION = 0.5  # of a parameter's variance in a direction: it takes part (Belsley)
_NOTHING = 1e-12  # eigenvalue of the scaled information that is rounding
_SURPRISE = 3.0  # standard deviations between a-priori value and data that are worth a word
_UNMOVED = 0.9  # posterior over prior 1-sigma: the data did not move it


@dataclass(frozen=True, eq=False, kw_only=True)
class Direction:
    """A combination of parameters that the data hardly see."""

    singular_value: float  # of the scaled sensitivities (unit columns); 0: not seen at all
    condition: float  # largest singular value over this one
    # parameter -> change along the direction that alters the fit by one standard deviation of the noise (for a singular
    # value of 0 the parameter's own size)
    change: Mapping[str, float]
    share: Mapping[str, float]  # parameter -> the same over its estimate (inf: the estimate is zero)
    # whether that change is larger than the a-priori 1-sigma (without one: value) of a parameter that takes part, so
    # that they cannot be separated
    cannot: bool
    # controls in the names of those that take part (none there: all) that rested or moved at one frequency only
    poor: tuple[Excitation, ...]
    help: Suggestion | None  # the manoeuvre that would help most; None when none of those tried does

    @property
    def sentence(self) -> str:
        names = list(self.change)
        many = " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 2 else " from ".join(names)
        able = "cannot" if self.cannot else "can hardly" if self.condition > _STRONG else "only weakly"
        what = f"tell {many}" + (" apart" if len(names) > 2 else "") if len(names) > 1 else f"see {many}"
        together = ", ".join(f"{name} {self._shift(name)}" for name in names)
        price = "does not alter the fit" if self.singular_value == 0.0 else "alters the fit by one standard deviation"
        how = f"a change of {together}{' together' if len(names) > 1 else ''} {price}"
        advice = "; fix one, or give a prior" if self.cannot else ""
        helped = self.help.sentence if self.help else f"no manoeuvre tried would help{advice}"
        because = f" ({'; '.join(e.in_short for e in self.poor)})" if self.poor else ""
        return f"these data {able} {what}{because}: {how}; {helped}"

    def _shift(self, name: str) -> str:
        """A change as a number and in per cent of the estimate."""
        part = f" ({self.share[name]:+.1%})" if abs(self.share[name]) < 10.0 else ""
        return f"{self.change[name]:+.3g}{part}"


@dataclass(frozen=True, kw_only=True)
class Blend:
    """A-priori value and data together, for a parameter with a prior: `value` and `std` of both, `data_std` of the data
    alone (inf: none), `moved` whether the data reduced its uncertainty by more than a tenth."""

    name: str
    prior: float
    prior_std: float
    value: float
    std: float
    data_std: float
    moved: bool

    @property
    def surprise(self) -> float:
        """Distance of the data's estimate from the a-priori value over the 1-sigma of their difference."""
        # the blended value has gone its share of the way, and that has the variance that was gained
        gained = self.prior_std**2 - self.std**2
        return abs(self.value - self.prior) / math.sqrt(gained) if gained > 0.0 else 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Identifiability:
    """Report of `identifiability`; `print` it.

    Attributes
    ----------
    names
        Parameters, in the order of the rows of `vectors`.
    singular_values
        (k,) of the scaled sensitivities, largest first; k leaves out the `unseen` parameters.
    vectors
        (parameters, k) directions that belong to them, as columns.
    inflation
        Parameter -> its std over what it would be were all others known (inf: not determined).
    unseen
        Parameters that nothing in the data depends on, with the manoeuvre that would show most of each.
    exchanged
        Parameter -> states whose initial values, of which nothing is known, can take its place.
    weak
        Directions whose condition index is above 10.
    blends
        Parameters with an a-priori uncertainty.
    excitation
        How the controls moved.

    Examples
    --------
    After the example of `identifiability`:

    >>> told.inflation["k1"] > 100.0
    True
    """

    names: tuple[str, ...]
    singular_values: np.ndarray
    vectors: np.ndarray
    inflation: Mapping[str, float]
    unseen: Mapping[str, Suggestion | None]
    exchanged: Mapping[str, tuple[str, ...]]
    weak: tuple[Direction, ...]
    blends: Mapping[str, Blend]
    excitation: tuple[Excitation, ...]

    __repr__ = brief

    @property
    def condition(self) -> float:
        """Condition number of the scaled sensitivities."""
        least = self.singular_values[-1]
        return math.inf if least == 0.0 else float(self.singular_values[0] / least)

    def __str__(self) -> str:
        lines = [
            f"{len(self.names)} parameters, condition {self.condition:.3g} of the scaled sensitivities (below "
            f"{_INDEX:g} all are separated, above {_STRONG:g} some hardly)"
        ]
        lines += [f"- {moved.sentence}" for moved in self.excitation]
        for name, states in self.exchanged.items():
            lines.append(
                f"- these data cannot tell {name} from the initial value of {', '.join(states)}; give "
                f"InitialState(value={{...}}, std={{...}}) of it, or fix {name}"
            )
        for name, helped in self.unseen.items():
            if name in self.exchanged:
                continue
            cure = f"{helped.manoeuvre} would show it" if helped else "fix it, or give a prior"
            lines.append(f"- nothing in these data depends on {name}; {cure}")
        lines += [f"- {direction.sentence}" for direction in self.weak]
        if not self.weak and not self.unseen and not self.exchanged:
            lines.append("- every parameter is told apart from the others")
        still = [b for b in self.blends.values() if not b.moved]
        if self.blends:
            said = ", ".join(f"{b.name} ({b.std / b.prior_std:.0%} of its a-priori 1-sigma left)" for b in still)
            lines.append(f"- the data did not move {said}" if still else "- the data moved every a-priori value")
        for b in self.blends.values():
            if b.surprise > _SURPRISE:
                lines.append(
                    f"- the a-priori value of {b.name} is {b.surprise:.1f} standard deviations from the data's"
                )
        return "\n".join([*lines, "", self.rows().text()])

    def rows(self) -> Rows:
        """A row for each parameter: inflation of its deviation, and where there are priors, them and the blend."""
        heads = {"parameter": "", "std inflated by": ".2f"}
        if self.blends:
            heads |= {"a priori": ".4g", "a-priori std": ".2g", "blended": ".4g", "blended std": ".2g"}
        rows = []
        for name in self.names:
            b = self.blends.get(name)
            both = (b.prior, b.prior_std, b.value, b.std) if b else (None,) * 4
            rows.append((name, self.inflation[name], *(both if self.blends else ())))
        return Rows(heads=heads, rows=rows)


@single_threaded()
@singular_is("identifiability", "the states of a record are not determined; give InitialState(std={...})")
def identifiability(
    fit: Fit, *, controls: Sequence[str] | None = None, method: MultipleShooting = _DEFAULT_METHOD
) -> Identifiability:
    """Analyse which parameters the data of a fit determine, whether it used a prior or not.

    The a-priori blend uses the model's `prior_std`; where the fit left it out, it is put in by one linear step. With
    weights that are no inverse noise the information is that of the weights.

    Parameters
    ----------
    fit
        Of `solve`.
    controls
        Inputs that a pilot moves, for what would help; default: those named `delta_...` that the model depends on.
    method
        As in `relinearise`.

    Returns
    -------
    Identifiability
        Print it for singular values, the inflation of each standard error, weak directions and unseen parameters.

    Raises
    ------
    InputError
        For an unknown control.

    Examples
    --------
    Only the product of two gains acts on the output:

    >>> import numpy as np, casid as cs
    >>> gains = cs.define_model(
    ...     "gains", states=["x"], inputs=["u"], parameters={"k1": 2.0, "k2": 0.5}, outputs=["y"],
    ...     dynamics=lambda s: {"x": s.u - s.x}, output=lambda s: {"y": s.k1 * s.k2 * s.x},
    ... )
    >>> t = 0.05 * np.arange(200)
    >>> step = cs.Record(name="step", t=t, channels={"u": np.sin(t)})
    >>> flown = cs.simulate(gains, step, [0.0]).as_record("flown")
    >>> fit = cs.solve(cs.Problem(model=gains, records=[flown], free=["k1", "k2"], noise={"y": 0.01}))
    >>> told = cs.identifiability(fit)
    >>> told.names, len(told.weak)
    (('k1', 'k2'), 1)
    """
    require(fit, Fit, "identifiability: fit", "cs.solve(problem)")
    problem = fit.problem
    check_known("input", controls or (), problem.model.inputs, "identifiability: controls")
    moved_by = _surfaces(problem.model) if controls is None else tuple(controls)
    at = relinearise(fit, method)
    information = at.information
    names = problem.parameters
    seen = _Seen(information, _sizes(fit))
    moves = excitations(problem.records, moved_by)
    found = list(candidates(fit, moved_by)) if seen.weak or not seen.some.all() else []
    told = determined(at.objective, at.linear, fit.multipliers)
    exchanged = dict.fromkeys(told.lost, told.states) if told.states else {}
    inflation = seen.inflation
    inflation[np.isin(names, list(exchanged))] = np.inf
    return Identifiability(
        names=names,
        singular_values=seen.singular,
        vectors=seen.vectors,
        inflation=dict(zip(names, inflation.tolist(), strict=True)),
        unseen={
            names[i]: best_manoeuvre(found, information, np.eye(len(names))[i]) for i in np.flatnonzero(~seen.some)
        },
        exchanged=exchanged,
        weak=tuple(_direction(fit, seen, k, moves, best_manoeuvre(found, information, seen.at(k))) for k in seen.weak),
        blends=_blends(fit, information),
        excitation=moves,
    )


def _surfaces(model: Model) -> tuple[str, ...]:
    acts = ca.which_depends(ca.vertcat(model.f, model.h), model.u, 1, False)
    return tuple(n for n, a in zip(model.inputs, acts, strict=True) if a and n.startswith("delta_"))


def _sizes(fit: Fit) -> np.ndarray:
    """(parameters,) what a change of each is compared with: a-priori 1-sigma, else a-priori value; NaN for neither."""
    known = fit.problem.model.prior_std
    sizes = [known.get(bare_name(fit.problem.model, name), 0.0) or abs(e.prior) for name, e in fit.parameters.items()]
    return np.array([size if size > 0.0 else math.nan for size in sizes])


class _Seen:
    """What the data show of the parameters: directions of the scaled information (parameters, parameters), clearest
    first. `size` (parameters,) is what a change of each is compared with."""

    def __init__(self, information: np.ndarray, size: np.ndarray) -> None:
        self.size = size
        diagonal = np.diagonal(information)
        # less than one per cent of a standard deviation for a change of a hundred times the size is nothing
        self.some = np.where(np.isnan(size), diagonal > 0.0, diagonal * np.nan_to_num(size) ** 2 > 1e-8)
        self.scale = np.where(self.some, 1.0 / np.sqrt(np.where(self.some, diagonal, 1.0)), 0.0)
        eigenvalues, vectors = np.linalg.eigh(information * np.outer(self.scale, self.scale))
        order = [i for i in np.argsort(-eigenvalues) if np.abs(vectors[self.some, i]).max(initial=0.0) > 1e-6]
        values = np.where(eigenvalues[order] > _NOTHING, eigenvalues[order], 0.0)
        self.singular = np.sqrt(values)
        self.vectors = vectors[:, order]
        self.shares = self.vectors**2 / np.maximum(values, _NOTHING)
        self.total = self.shares.sum(axis=1)
        root = np.sqrt(np.where(self.some, self.total, np.inf))
        # (parameters, parameters) correlation of the estimates, zero of each with itself
        self.together = (self.vectors / np.maximum(values, _NOTHING)) @ self.vectors.T / np.outer(root, root)
        np.fill_diagonal(self.together, 0.0)

    @property
    def weak(self) -> list[int]:
        """Directions that the data show little of, beside the clearest one; weakest first."""
        return [k for k in reversed(range(len(self.singular))) if self.singular[0] > _INDEX * self.singular[k]]

    @property
    def inflation(self) -> np.ndarray:
        """(parameters,) by which factor their standard deviations are larger than if all others were known."""
        return np.where(self.some & (self.total <= 0.01 / _NOTHING), np.sqrt(self.total), np.inf)

    def at(self, k: int) -> np.ndarray:
        """(parameters,) linear function of the parameters that a direction is about."""
        return np.divide(self.vectors[:, k], self.scale, out=np.zeros_like(self.scale), where=self.scale > 0)


def _direction(
    fit: Fit, seen: _Seen, k: int, moves: Sequence[Excitation], most_helpful: Suggestion | None
) -> Direction:
    # A weak direction of unit columns has two members at least. Directions of like singular values share variance out
    # among them, so that the partner of a single one is what its estimate is most correlated with.
    part = seen.shares[:, k] / np.where(seen.some, seen.total, 1.0)
    along = seen.scale * seen.vectors[:, k]
    ranked = [int(i) for i in np.argsort(-part)]
    members = [i for i in ranked if part[i] > _PROPORTION] or ranked[:1]
    if len(members) < 2:
        members.append(int(np.argmax(np.abs(seen.together[members[0]]))))
    singular = float(seen.singular[k])
    lost = singular == 0.0
    own = np.where(np.isnan(seen.size), 1.0, seen.size)[members]
    change = along / singular if not lost else along * np.min(own / np.abs(along[members]))
    change = change * np.sign(change[members[0]])
    names = fit.problem.parameters
    cannot = lost or bool((np.abs(change[members]) > seen.size[members]).any())
    values = [abs(fit[names[i]].value) for i in members]
    share = {names[i]: float(change[i] / v) if v > 0.0 else math.inf for i, v in zip(members, values, strict=True)}
    return Direction(
        singular_value=singular,
        condition=math.inf if lost else float(seen.singular[0]) / singular,
        change={names[i]: float(change[i]) for i in members},
        share=share,
        cannot=cannot,
        poor=_poor([names[i] for i in members], moves),
        help=most_helpful,
    )


def _poor(members: Sequence[str], moves: Sequence[Excitation]) -> tuple[Excitation, ...]:
    """Controls that excite a direction poorly: those that its members name, else all."""
    named = [m for m in moves if any(m.control in member for member in members)]
    return tuple(m for m in named or moves if m.poor)


def _blends(fit: Fit, information: np.ndarray) -> dict[str, Blend]:
    problem = fit.problem
    known = problem.model.prior_std
    std = np.array([known.get(name, np.inf) for name in problem.bare])
    if not np.isfinite(std).any():
        return {}
    precision = np.diag(1.0 / std**2)
    posterior = _inverse(information + precision)
    alone = np.diagonal(_inverse(information))
    values = np.array(list(fit.values.values()))
    if not problem.prior:
        values = values + posterior @ precision @ (problem.nominal - values)
    spread = np.sqrt(np.diagonal(posterior))
    return {
        name: Blend(
            name=name,
            prior=float(problem.nominal[i]),
            prior_std=float(std[i]),
            value=float(values[i]),
            std=float(spread[i]),
            data_std=float(np.sqrt(alone[i])),
            moved=bool(spread[i] < _UNMOVED * std[i]),
        )
        for i, name in enumerate(problem.parameters)
        if np.isfinite(std[i])
    }


def _inverse(information: np.ndarray) -> np.ndarray:
    """Covariance of an information matrix; the variance of what it does not determine is infinite."""
    diagonal = np.diagonal(information)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    eigenvalues, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    lost = eigenvalues < _NOTHING
    kept = vectors[:, ~lost]
    covariance = np.outer(scale, scale) * ((kept / eigenvalues[~lost]) @ kept.T)
    touched = (np.abs(vectors[:, lost]) > 1e-6).any(axis=1)
    covariance[touched, touched] = np.inf
    return covariance
