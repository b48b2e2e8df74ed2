"""Vectors and rotors as effects change them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from casid.model.effect import Forms
from casid.model.rotors import Rotor, Rotors, changed


def in_numbers(target: str, numbers: Callable[[Rotor, float], Mapping[str, Any]]) -> Forms:
    """The form of an effect whose value changes numbers of each rotor that its target names."""

    def into_rotors(rotors: Rotors, weight: float, value: float) -> Rotors:
        return changed(rotors, target, lambda one: numbers(one, value))

    return Forms(into_rotors=into_rotors)


def shifted(vector: Sequence[float], axis: str, by: float) -> tuple[float, ...]:
    """A vector with more along an axis."""
    return tuple(map(float, vector + by * np.eye(3)["xyz".index(axis)]))


def turned(vector: Sequence[Any], about: str, cosine: Any, sine: Any) -> list[Any]:
    """A vector turned about an axis."""
    i, j = ((1, 2), (2, 0), (0, 1))["xyz".index(about)]
    found = list(vector)
    found[i] = cosine * vector[i] - sine * vector[j]
    found[j] = sine * vector[i] + cosine * vector[j]
    return found
