"""Modes of motion: eigenvalues of the linearised aircraft by the names of the field, with exact derivatives.

A mode belongs to the plane in which its states take part most; participation is |left x right eigenvector| by state,
which no choice of units changes. A single eigenvalue has the derivative w' dA v / (w' v) by the left and right
eigenvectors w and v (Lancaster, Numerische Mathematik 6, 1964).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eig

LONGITUDINAL = ("u", "w", "q", "theta")
LATERAL = ("v", "p", "r", "phi")
_REAL = 1e-9  # of the size of an eigenvalue: an imaginary part below is rounding
_COUPLED = 1e-12  # of the largest entry of the matrix: what is less couples no planes


@dataclass(frozen=True, eq=False, kw_only=True)
class Eigenmode:
    """One real eigenvalue or one pair."""

    eigenvalue: complex  # the one with the imaginary part that is not negative [rad/s]
    derivatives: np.ndarray  # (parameters,) complex derivatives of the eigenvalue
    participation: Mapping[str, float]  # state -> its share in the mode; the shares add up to 1

    @property
    def oscillates(self) -> bool:
        """Return True if it is a pair."""
        return self.eigenvalue.imag > 0.0

    def share(self, states: Sequence[str]) -> float:
        """Share of these states in the mode."""
        return sum(self.participation.get(name, 0.0) for name in states)

    def numbers(self) -> dict[str, tuple[float, np.ndarray, str]]:
        """Return the numbers of the mode: name -> value, derivatives by the parameters, unit."""
        value = self.eigenvalue
        slope = self.derivatives
        sigma = value.real
        dsigma = np.real(slope)
        found: dict[str, tuple[float, np.ndarray, str]] = {}
        if self.oscillates:
            size = abs(value)
            dsize = np.real(value.conjugate() * slope) / size
            period = 2.0 * math.pi / value.imag
            found["natural_frequency"] = size, dsize, "rad/s"
            found["damping_ratio"] = -sigma / size, -dsigma / size + sigma * dsize / size**2, "1"
            found["period"] = period, -period * np.imag(slope) / value.imag, "s"
        elif sigma != 0.0:
            found["time_constant"] = -1.0 / sigma, dsigma / sigma**2, "s"
        if sigma != 0.0:
            time = math.log(2.0) / abs(sigma)
            name = "time_to_half" if sigma < 0.0 else "time_to_double"
            found[name] = time, -time * dsigma / sigma, "s"
        return found


def eigenmodes(A: np.ndarray, slopes: np.ndarray, states: Sequence[str]) -> list[Eigenmode]:
    """Solve for the modes of A (n, n) of the named states, fastest first; slopes (n, n, parameters) are the derivatives
    of A."""
    values, left, right = (np.asarray(part) for part in eig(A, left=True, right=True))
    found = []
    for k, value in enumerate(values):
        if value.imag < -_REAL * abs(value):
            continue
        w = left[:, k].conj()
        v = right[:, k]
        shares = np.abs(w * v)
        both = w @ v
        with np.errstate(divide="ignore", invalid="ignore"):  # of one eigenvector for two eigenvalues: no derivative
            derivative = np.einsum("i,ijp,j->p", w, slopes, v) / both
            shares = shares / shares.sum()
        single = abs(value.imag) <= _REAL * abs(value)
        found.append(
            Eigenmode(
                eigenvalue=complex(value.real, 0.0) if single else complex(value),
                derivatives=np.real(derivative) + 0j if single else derivative,
                participation=dict(zip(states, shares.tolist(), strict=True)),
            )
        )
    return sorted(found, key=lambda mode: -abs(mode.eigenvalue))


def by_plane(A: np.ndarray, slopes: np.ndarray, states: Sequence[str]) -> tuple[list[Eigenmode], list[str]]:
    """The modes of a matrix, and planes of motion that have none: those without any aerodynamic damping. Planes that do
    not act on each other are taken apart, so that what is missing in one does not disturb the other."""
    lateral = [i for i, name in enumerate(states) if name in LATERAL]
    others = [i for i in range(len(states)) if i not in lateral]
    coupling = max(np.abs(A[np.ix_(lateral, others)]).max(), np.abs(A[np.ix_(others, lateral)]).max())
    damping = [i for i in lateral if states[i] in ("v", "p", "r")]
    silent = [] if np.abs(A[damping, damping]).max() > 0.0 else ["lateral"]
    if coupling > _COUPLED * np.abs(A).max() and not silent:
        return eigenmodes(A, slopes, states), silent
    blocks = [others] if silent else [others, lateral]
    found = [
        mode
        for block in blocks
        for mode in eigenmodes(A[np.ix_(block, block)], slopes[np.ix_(block, block)], [states[i] for i in block])
    ]
    return sorted(found, key=lambda mode: -abs(mode.eigenvalue)), silent


def named(modes: Sequence[Eigenmode]) -> dict[str, Eigenmode]:
    """Name the modes: short period, phugoid, dutch roll, roll, spiral, in this order.

    Of longitudinal pairs the fastest is the short period, the next the phugoid; where one has split into real
    eigenvalues they are "longitudinal 1", "longitudinal 2". Of the lateral ones the fastest pair is the dutch roll, a
    second one the "lateral phugoid"; the faster real one is the roll. States that effects add are "further 1" and so
    on.
    """
    further = [m for m in modes if m.share(LONGITUDINAL + LATERAL) < 0.5]
    rigid = [m for m in modes if m not in further]
    plane = {
        "longitudinal": [m for m in rigid if m.share(LONGITUDINAL) >= m.share(LATERAL)],
        "lateral": [m for m in rigid if m.share(LONGITUDINAL) < m.share(LATERAL)],
    }
    found: dict[str, Eigenmode] = {}
    for which, pair_names, real_names in (
        ("longitudinal", ("short period", "phugoid"), ()),
        ("lateral", ("dutch roll", "lateral phugoid"), ("roll", "spiral")),
    ):
        pairs = [m for m in plane[which] if m.oscillates]
        single = [m for m in plane[which] if not m.oscillates]
        if which == "longitudinal" and len(pairs) == 1 and len(single) == 2:
            # the slower motion may be the one that split
            faster = abs(pairs[0].eigenvalue) > min(abs(m.eigenvalue) for m in single)
            pair_names = pair_names if faster else pair_names[::-1]
        found |= dict(zip(pair_names, pairs, strict=False))
        names = real_names if len(single) <= len(real_names) and len(pairs) < 2 else ()
        left = [f"{which} {k + 1}" for k in range(len(single) - len(names))]
        found |= dict(zip((*names, *left), single, strict=False))
    return found | {f"further {k + 1}": m for k, m in enumerate(further)}
