"""Keep what is built of a model once, in the model."""

from __future__ import annotations

from collections.abc import Callable, Hashable

import casadi as ca

from casid.model.system import Model
from casid.native.compiler import Compilable

_BUILT = "_built"  # attribute of the model that holds it


def cached(model: Model, key: tuple, build):
    """Return `build()`, computed once and kept as long as the model lives: a Monte Carlo over one model builds once.

    The model holds it, since much of it refers to the model: a table of weak references would never free either.
    """
    store = vars(model).setdefault(_BUILT, {})
    if key not in store:
        store[key] = build()
    return store[key]


def share_cache(model: Model, like: Model) -> Model:
    """The model, of the same expressions as `like`, with one store of what is built of them."""
    vars(model)[_BUILT] = vars(like).setdefault(_BUILT, {})
    return model


def compiled(model: Model, make: Callable[..., ca.Function], *given: Hashable) -> Compilable:
    """The function `make(model, *given)`, to be compiled once that pays; kept likewise."""
    return cached(model, (make, *given), lambda: Compilable(make(model, *given)))
