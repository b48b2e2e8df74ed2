"""Algebraic states z of a model, 0 = g(x, z, u, p, w), as expressions of the other symbols.

Index 1 means that dg/dz is regular, so that z is a function of x, u and p: at the first sample too, where it is thereby
consistent, and at every stage of an integration. Where g is linear in z that function is written out. Elsewhere it is a
call of Newton's method, whose derivatives are those of the implicit function theorem; a call that finds no root gives
no number, as a square root of a negative one does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from casid.errors import InputError

_SOLVED = 1e-8  # of a state or its start: a further step of Newton's method at the root
_STEPS = 100


def algebraic_states(z: ca.SX, balance: ca.SX, start: Mapping[str, float], known: Sequence[ca.SX], where: str) -> ca.SX:
    """(z,) expressions of the `known` vectors that solve balance = 0, by Newton's method from `start` by name. Raises
    InputError for a balance that does not determine them."""
    names = tuple(start)
    slope = ca.jacobian(balance, z)
    if ca.sprank(slope) < len(names):
        raise InputError(
            f"{where}: balance does not determine {', '.join(names)}, because its derivatives in them are singular at "
            "all values (index above 1); differentiate an equation with respect to time"
        )
    if not ca.depends_on(slope, z):
        return -ca.solve(slope, ca.substitute(balance, z, ca.SX.zeros(len(names))))
    begin = np.array(list(start.values()))
    given = ca.vertcat(*known)
    options = {"error_on_fail": False, "max_iter": _STEPS, "show_eval_warnings": False}
    root = ca.rootfinder("algebraic", "newton", {"x": z, "p": given, "g": balance}, options)
    found = root(begin, given)
    further = ca.fabs(ca.substitute(ca.solve(slope, balance), z, found))
    good = ca.SX(1)
    for i, size in enumerate(np.abs(begin)):
        good = ca.logic_and(good, further[i] <= _SOLVED * (ca.fabs(found[i]) + size))
    return ca.if_else(good, found, np.nan)
