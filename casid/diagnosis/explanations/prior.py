"""What is believed before the records, and what a wrong name costs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casid.diagnosis.criterion import number
from casid.diagnosis.numerics import ScoreNumerics


@dataclass(frozen=True, kw_only=True)
class Priors:
    """What a wrong name costs; and what the score of a system's explanations believes beforehand."""

    another: float = number(
        0.5, "odds that one more thing is wrong", "chosen: several causes at once are rarer than one"
    )
    outside: float = number(0.2, "share of these odds for what no catalogue has", "chosen: a fifth of first findings")
    sizes: tuple[float, ...] = number(
        (0.3, 1.0, 3.0, 10.0, 30.0),
        "1-sigmas of a cause's size, in units of what matters, with equal odds",
        "chosen: two decades make heavy tails, so that no size is excluded",
    )
    grid: float = number(
        0.35, "1-sigma of the amplitude at a grid point of a nonlinear size", "derived: grids go by factors of two"
    )
    levels: tuple[float, ...] = number(
        (0.1, 0.3, 1.0, 3.0, 10.0, 30.0),
        "1-sigmas of an unknown history, in units of what matters",
        "chosen: as sizes; those below one are the colour that instruments and models leave",
    )
    coloured: float = number(0.2, "odds, for each port, of an unknown history below what matters")
    times: tuple[float, ...] = number(
        (0.4, 1.5, 6.0),
        "correlation times of unknown histories",
        "chosen: quicker than a manoeuvre, as quick, and slower",
        unit="s",
    )
    base: tuple[float, ...] = number(
        (0.0, 0.02, 0.1, 0.5),
        "levels of histories at all ports at once, in units of what matters, with equal odds",
        "chosen: none, and up to half of what matters, where only slow or large causes are told from them",
    )
    bends: tuple[float, ...] = number(
        (1.0, 2.0, 4.0), "scales of the small terms of a coefficient, with equal odds", "derived: structure.scales"
    )
    doubt: float = number(
        0.01,
        "probability that columns, noise or priors are wrong altogether, by which all that is told is less sure",
        "measured: 11 of some 1000 names that blind flights were given were wrong (problems/blind/results.md)",
    )
    wrong: float = number(10.0, "cost of a wrong name", "chosen: it sends someone to look in the wrong place")
    missed: float = number(1.0, "cost of a name that is not given", "derived: the unit of cost")
    holds: float = number(0.95, "probability that a set of causes which stand for each other must hold")
    alike: float = number(0.8, "cosine of responses from which causes may stand for each other")
    adds: float = number(0.005, "probability below which a cause is no member of such a set")
    numerics: ScoreNumerics = ScoreNumerics()

    @property
    def named(self) -> float:
        """Probability from which a name is worth its risk: the cost of a wrong one over the sum of both costs."""
        return self.wrong / (self.wrong + self.missed)

    def tempered(self, probability: float) -> float:
        """What is told of a probability within columns, noise and priors."""
        return (1.0 - self.doubt) * probability

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
