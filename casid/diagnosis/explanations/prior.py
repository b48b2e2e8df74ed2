"""What is believed before the records, and what a wrong name costs: all numbers that decide which causes are named."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Priors:
    """Priors and costs of the score.

    another            odds that there is one more thing wrong: simulations that are flown are mostly right, and several
                       causes at once are rarer than one
    outside            share of these odds for what no catalogue has: a fifth of the first findings on foreign flights
    improbable         factor on the odds of what contradicts the symmetry of an aircraft
    sizes              1-sigma of a cause's size, in units of the smallest that matters, with equal odds: sums of
                       Gaussians over two decades have heavy tails, so that no size is excluded
    grid               1-sigma of the amplitude of a cause at a grid point of its non-linear size: neighbouring points
                       of the grids are a factor of two apart
    levels             of an unknown history, as `sizes` are of a cause. Those below one are what instruments and models
                       always leave: coloured, and too small to matter
    coloured           odds, for each port, of such a level
    times              s, correlation times of unknown histories: quicker than any manoeuvre, as quick, and slower
    base               levels of histories at all ports in every explanation, with equal odds
    bends              scales of small terms, with equal odds: 1 % a part at the most, some 4 % in all
    wrong, missed      cost of a wrong name, and of one that is not given: a name sends someone to look, and a wrong one
                       costs more than the hint that something unexplained is left
    """

    another: float = 0.5
    outside: float = 0.2
    improbable: float = 0.1
    sizes: tuple[float, ...] = (0.3, 1.0, 3.0, 10.0, 30.0)
    grid: float = 0.35
    levels: tuple[float, ...] = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
    coloured: float = 0.2
    times: tuple[float, ...] = (0.4, 1.5, 6.0)
    base: tuple[float, ...] = (0.0, 0.02)
    bends: tuple[float, ...] = (1.0, 2.0, 4.0)
    wrong: float = 10.0
    missed: float = 1.0

    @property
    def named(self) -> float:
        """Probability from which a name is worth its risk."""
        return self.wrong / (self.wrong + self.missed)

    def cause(self, kinds: int, alternatives: float = 1.0) -> float:
        """Log odds of a cause: of so many kinds, of which it is one of so many alternatives."""
        return float(np.log(self.another * (1.0 - self.outside) / kinds / alternatives))

    def unknown(self, ports: int) -> float:
        """Log odds of something unknown at one of so many ports."""
        return float(np.log(self.another * self.outside / ports))

    def level(self, level: float, log_prior: float) -> float:
        """Log odds of a level of an unknown history that has `log_prior` if it matters."""
        small = [one for one in self.levels if one < 1.0]
        if level < 1.0:
            return float(np.log(self.coloured / len(small) / len(self.times)))
        return log_prior - float(np.log((len(self.levels) - len(small)) * len(self.times)))
