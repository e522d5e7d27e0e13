"""What is known before the data: how many parameters change, and by how much.

Which: either separate faults, each parameter changed with probability π; or, with the small probability `worn`,
an engine that is worn, where any number of changed parameters is as probable as any other. How often faults come
together is not known beforehand: π is one of several, each as probable as the others, and the data say which. A set of
k of p parameters then has the probability

    P(S) = (1 − worn) mean over π of π^k (1 − π)^(p−k) + worn / ((p + 1) C(p, k)).

The first part alone would exclude an engine that is worn throughout, however clear the data (on multiplicity and
priors over the size of a set: Scott, J. G. and Berger, J. O. (2010) Annals of Statistics 38, 2587–2619).

Sensors, those of the model's inputs included, do not wear together: each of m is wrong with probability `sensor`,
whatever the engine did, and no more than `wrong_sensors` of them at once, so that a set of parameters and j sensors has

    P(S) = P(parameters of S) · sensor^j (1 − sensor)^(m−j) / Σ_{i ≤ wrong_sensors} C(m, i) sensor^i (1 − sensor)^(m−i).

How much: a change of a parameter is N(0, slab² · prior_sigma²), where the slab is common to the parameters of a
set and one of `slabs`, each as probable as the others. With prior_sigma of 2 %, as health parameters have it, the
three widths stand for changes of about 0.3 %, 1 % and 3 %. What wear can only lower, as efficiencies, has risen with
the probability `rises` where it has changed: modules are repaired and exchanged. Of an instrument the slab is
`instruments` times as wide. Its prior_sigma is a plausible bias, three times its noise, and what instruments differ by
from flight to flight is counted beside; one that is *wrong* is off by about half of that bias, by one and a half, or
by several. Narrower ones are not seen, so that records never speak against them, and a broken probe exceeds them by so
much that a change of the engine is found less improbable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.parameters import Parameter

if TYPE_CHECKING:
    from enginediag_cli.residuals.score import Score


def are_sensors(parameters: Sequence[Parameter]) -> np.ndarray:
    """Which parameters (p,) are errors of instruments, of a measured output or of an input."""
    return np.array([p.of_instrument for p in parameters], bool)


@dataclass(frozen=True)
class SetPrior:
    """inclusion, worn and sensor: probabilities; slabs: sizes of a change, in prior_sigma; wrong_sensors: at most, at
    once; spread: factors on the odds of inclusion, which give the π; rises: chance that a parameter that changed went
    against its wear, 0.5 where nothing is known of that; instruments: by how much slabs are wider for instruments'
    errors.

    sensor: of sixteen instruments one is then wrong in one window of thirteen. The chance is taken from every answer
    that records cannot defend against a wrong instrument beside it, as single records cannot.
    """

    inclusion: float = 0.1
    worn: float = 0.05
    slabs: tuple[float, ...] = (0.15, 0.5, 1.5)
    sensor: float = 0.005
    wrong_sensors: int = 2
    spread: tuple[float, ...] = (0.5, 1.0, 2.0)
    rises: float = 0.05
    instruments: float = 3.0

    def __post_init__(self) -> None:
        if not 0 < self.inclusion < 1:
            raise ValueError("`inclusion` must lie between 0 and 1")
        if not 0 <= self.worn <= 1:
            raise ValueError("`worn` must lie in [0, 1]")
        if not 0 < self.sensor < 1 or self.wrong_sensors < 0:
            raise ValueError("`sensor` must lie between 0 and 1, and `wrong_sensors` not be negative")
        if not 0 < self.rises < 1:
            raise ValueError("`rises` must lie between 0 and 1")
        if not 0 < self.instruments < np.inf:
            raise ValueError("`instruments` must be positive and finite")
        if not self.spread or not all(0 < factor < np.inf for factor in self.spread):
            raise ValueError("`spread` must be positive and finite, one at least")
        if not self.slabs or not all(0 < slab < np.inf for slab in self.slabs):
            raise ValueError("`slabs` must be positive and finite, one at least")

    @property
    def chances(self) -> np.ndarray:
        """π of separate faults (n,), each as probable as the others."""
        odds = self.inclusion / (1 - self.inclusion) * np.asarray(self.spread)
        return np.asarray(odds / (1 + odds))

    def widths(self, parameters: Sequence[Parameter]) -> np.ndarray:
        """Size (p,) of a change by one slab, in prior_sigma of each parameter."""
        return np.where(are_sensors(parameters), self.instruments, 1.0)

    def scaled(self, score: Score) -> tuple[np.ndarray, np.ndarray]:
        """Score (p,) and information (p, p) of changes in these `widths`."""
        b, information = score.scaled()
        wide = self.widths(score.described)
        return wide * b, wide[:, None] * information * wide

    def log_of_size(self, p: int) -> np.ndarray:
        """log P(S) (p + 1,) of one set of each size 0…p among p parameters."""
        from scipy.special import betaln

        k = np.arange(p + 1)
        each = k[:, None] * np.log(self.chances) + (p - k)[:, None] * np.log1p(-self.chances)
        separate = np.logaddexp.reduce(each, axis=1) - np.log(len(self.chances))
        with np.errstate(divide="ignore"):
            # 1/((p + 1) C(p, k)) = B(1 + k, 1 + p − k)
            return np.asarray(
                np.logaddexp(np.log1p(-self.worn) + separate, np.log(self.worn) + betaln(1 + k, 1 + p - k))
            )

    def log_of(self, masks: np.ndarray, sensors: np.ndarray) -> np.ndarray:
        """log P(S) (M,) of sets (M, p) bool; sensors (p,) bool: which parameters are errors of sensors."""
        size, wrong = (masks & ~sensors).sum(axis=1), (masks & sensors).sum(axis=1)
        return self.log_of_counts(size, wrong, len(sensors), int(sensors.sum()))

    def log_of_counts(self, size: np.ndarray, wrong: np.ndarray, p: int, m: int) -> np.ndarray:
        """log P(S) (M,) of sets of `size` parameters of the engine and `wrong` sensors (M,), of p − m and m."""
        log = self.log_of_size(p - m)[size]
        if not m:
            return log
        from scipy.special import bdtr

        few = np.log(bdtr(min(self.wrong_sensors, m), m, self.sensor))
        own = wrong * np.log(self.sensor) + (m - wrong) * np.log1p(-self.sensor) - few
        return np.asarray(log + np.where(wrong <= self.wrong_sensors, own, -np.inf))

    def draw(
        self,
        rng: np.random.Generator,
        count: int,
        p: int,
        sensors: np.ndarray | None = None,
        wear: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """`count` engines from this prior: which changed (count, p) bool, by how many prior_sigma (count, p).

        sensors (p,) bool: which are errors of sensors; wear (p,): way on which wear takes each, 0 where both.
        """
        # a chance that is itself uniform makes all numbers of changes equally probable
        separate = rng.choice(self.chances, size=count)
        chance = np.where(rng.random(count) < self.worn, rng.random(count), separate)
        changed = rng.random((count, p)) < chance[:, None]
        if sensors is not None and sensors.any():
            again = np.arange(count)
            while again.size:
                changed[np.ix_(again, sensors)] = rng.random((len(again), int(sensors.sum()))) < self.sensor
                again = again[changed[np.ix_(again, sensors)].sum(axis=1) > self.wrong_sensors]
        slab = rng.choice(np.asarray(self.slabs), size=(count, 1))
        size = slab * rng.standard_normal((count, p))
        if sensors is not None:
            size = np.where(sensors, self.instruments * size, size)
        if wear is not None and np.any(wear):
            way = np.where(rng.random((count, p)) < self.rises, -wear, wear)
            size = np.where(wear == 0, size, way * np.abs(size))
        return changed, np.where(changed, size, 0.0)
