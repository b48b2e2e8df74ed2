"""The motion of a fit, and the time histories along it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from casid.filtering.innovations import NoiseModel, scattered
from casid.model.system import Model


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """The motion of a fit."""

    X: np.ndarray  # (N, R, nx) trajectory
    coloured: np.ndarray  # (N, R, nc) most likely histories of the coloured disturbances
    inputs: np.ndarray  # (N, R, ni) most likely noise of the recorded inputs, in the order of the acting noise
    # (N, R, nx + nc) trajectory and coloured disturbances as they are predicted from the samples before, where a fit
    # compares prediction errors
    predicted: np.ndarray | None = None

    @property
    def about(self) -> tuple[np.ndarray, np.ndarray]:
        """Trajectory and coloured disturbances about which the model is linearised."""
        if self.predicted is None:
            return self.X, self.coloured
        nx = self.X.shape[2]
        return self.predicted[..., :nx], self.predicted[..., nx:]

    def of_records(self, some: slice | list[int]) -> Motion:
        """The same of some records, as views."""
        predicted = None if self.predicted is None else self.predicted[:, some]
        found = {"X": self.X[:, some], "coloured": self.coloured[:, some], "inputs": self.inputs[:, some]}
        return Motion(**found, predicted=predicted)

    def moved(self, step: Motion, length: float = 1.0) -> Motion:
        found = replace(
            self,
            X=self.X + length * step.X,
            coloured=self.coloured + length * step.coloured,
            inputs=self.inputs + length * step.inputs,
        )
        if self.predicted is None or step.predicted is None:
            return found
        return replace(found, predicted=self.predicted + length * step.predicted)


@dataclass(frozen=True, eq=False, kw_only=True)
class AlongMotion:
    """Time histories along the motion of a fit."""

    X: np.ndarray  # (N, R, nx) trajectory
    moving: np.ndarray  # (N, R, nw) coloured disturbances
    inputs: np.ndarray  # (N, R, nu) denoised inputs
    regressors: Any
    ahead: bool  # whether it is predicted from the samples before

    @cached_property
    def known(self) -> dict[str, np.ndarray]:
        """Name -> (N, R) denoised motion and inputs."""
        return self.regressors.along(self.X, self.moving, self.inputs, self.ahead)


def along_motion(
    regressors: Any, model: Model, acting: NoiseModel, motion: Motion, further: np.ndarray | float = 0.0
) -> AlongMotion:
    """The time histories along a motion, with `further` disturbances (N, R, nw).

    Where prediction errors are compared it is the predicted motion. The most likely one follows from later samples too:
    what is made of it explains part of the very innovations that moved it, whether the effect exists or not.
    """
    X, coloured = motion.about
    moving = scattered(model, acting.coloured, coloured) + further
    inputs = regressors.inputs(dict(zip(acting.inputs, np.moveaxis(motion.inputs, 2, 0), strict=True)))
    ahead = motion.predicted is not None
    return AlongMotion(X=X, moving=moving, inputs=inputs, regressors=regressors, ahead=ahead)
