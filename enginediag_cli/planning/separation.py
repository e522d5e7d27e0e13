"""How far further records separate alternative hypotheses, and how probably the right one is then identified.

A hypothesis h predicts the readings y_h of a record, in standard deviations of their noise, and how they answer to
whatever it may adapt: Y_h, the columns of everything that is identified, of its own coefficients and of a new
recording's offsets, each per standard deviation that is known of it. If h is true, n records of which G is the mean
Gram matrix, with d = y_h − y_g, leave the hypothesis g with a χ² more, after it has adapted, by

    λ_hg(n) = min_y n⟨|d − Y_g y|²⟩ + |y|² = n G_dd − n² G_dY (1 + n G_YY)⁻¹ G_Yd ,

which is λ_sep(I + nG) − λ_sep(I) of the score test's information I where g is what h would be taken for: what records
like those flown have taught is in the standard deviations of Y. What nobody has flown is as uncertain as its prior, and
so is how g would err there. The log odds of h over g are normal, of mean ½λ + ln(p_h/p_g) and variance λ. The right one
is identified where they are ln ODDS against every other; of several,

    P(n) = Σ_h p_h Π_{g≠h} Φ( (½λ_hg + ln(p_h/p_g) − ln ODDS) / √λ_hg ) ,

for two exactly, for more as if their log odds were independent: less than the truth where those rise and fall
together, as those of like hypotheses do (D. Slepian, "The one-sided barrier problem for Gaussian noise", Bell Syst.
Tech. J. 41 (1962) 463–501). What h itself does is taken as fitted.

A recording that was judged, and the best of each kind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from enginediag_cli.planning.flights import RECORDS, PlannedFlight

ODDS = 19.0
"""To one, at which the right explanation is identified: a probability of 95 %."""
SURE = 0.9
"""Probability of standing out at which records are enough. Judgement: the tenth needs one flight more."""
MOST_RECORDS = 10_000
"""More than a recording to come would have: reported as “never”. (A flight of three hours at one a second.)"""


TRIED = 16
"""Numbers of records, each twice the one before or so, that are tried for the fewest."""


@dataclass(frozen=True)
class Adaptation:
    """What a hypothesis may adapt to records of one kind: its columns Y (k, m, q), eigenvalues (q,) and vectors (q,
    q) of G_YY."""

    columns: np.ndarray
    values: np.ndarray
    vectors: np.ndarray

    @classmethod
    def from_columns(cls, columns: np.ndarray) -> Adaptation:
        """Of typical records: Y (k, m, q), per standard deviation."""
        rows = columns.reshape(columns.shape[0] * columns.shape[1], columns.shape[2])
        values, vectors = np.linalg.eigh(rows.T @ rows / len(columns))
        return cls(columns, np.maximum(values, 0.0), vectors)

    def separation(self, difference: np.ndarray) -> Separation:
        """From what foresees another reading by d (k, m)."""
        k = len(difference)
        pull = np.einsum("kmq,km->q", self.columns, difference) / k
        return Separation(float(np.sum(difference**2)) / k, self.values, (self.vectors.T @ pull) ** 2)


@dataclass(frozen=True)
class Separation:
    """λ(n) of a hypothesis if another is true, over records of one kind. `size`: G_dd; `values` (q,): eigenvalues of
    G_YY; `pulls` (q,): squares of G_Yd along its vectors."""

    size: float
    values: np.ndarray
    pulls: np.ndarray

    @classmethod
    def from_gram(cls, gram: np.ndarray) -> Separation:
        """From G (1 + q, 1 + q) of [d Y]."""
        values, vectors = np.linalg.eigh(gram[1:, 1:])
        return cls(float(gram[0, 0]), np.maximum(values, 0.0), (vectors.T @ gram[1:, 0]) ** 2)

    def __call__(self, n: float) -> float:
        """λ of n records."""
        return max(float(n * self.size - n * n * np.sum(self.pulls / (1.0 + n * self.values))), 0.0)


def fewest(enough: Callable[[float], bool], most: int = MOST_RECORDS) -> float:
    """The least number of records from which on every number is enough; inf where `most` are not. Between TRIED numbers
    it is bisected: what a few records leave as it is, some more may yet upset."""
    tried = np.unique(np.geomspace(1, most, TRIED).round().astype(int))
    low = max((int(n) for n in tried if not enough(float(n))), default=0)
    if low == most:
        return float("inf")
    high = int(tried[np.searchsorted(tried, low, "right")])
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return float(high)


@dataclass(frozen=True)
class Outlook:
    """What records of one kind promise: `probabilities` (K,) of the hypotheses now; `separations`[h][g] of the
    hypothesis g if h is true, None where g need not be separated from h: g = h, or a g that holds all of h."""

    probabilities: np.ndarray
    separations: Sequence[Sequence[Separation | None]]

    def lambdas(self, n: float) -> np.ndarray:
        """λ_hg (K, K) of n records, infinite where there is nothing to separate."""
        return np.array([[np.inf if s is None else s(n) for s in row] for row in self.separations])

    def chance_each(self, n: float) -> np.ndarray:
        """(K,): the probability that each hypothesis is identified after n records, if it is true."""
        from scipy.special import ndtr

        p, lam = self.probabilities, self.lambdas(n)
        lead = np.log(p[:, None] / p) - np.log(ODDS)
        with np.errstate(divide="ignore", invalid="ignore"):
            z = np.where(lam > 0.0, 0.5 * np.sqrt(lam) + lead / np.sqrt(lam), np.where(lead >= 0.0, np.inf, -np.inf))
        return np.asarray(np.prod(ndtr(z), axis=1))

    def chance(self, n: float) -> float:
        """P(n), over the hypotheses that differ from another."""
        asked = [any(s is not None for s in row) for row in self.separations]
        weight = np.where(asked, self.probabilities, 0.0)
        return float(weight @ self.chance_each(n) / max(weight.sum(), 1e-300))

    @cached_property
    def records(self) -> float:
        """The fewest after which the right one is identified with the probability SURE; inf beyond MOST_RECORDS."""
        return fewest(lambda n: self.chance(n) >= SURE)


SAME, SWITCH, SENSOR = "same", "switch", "sensor"
"""Of recordings that are no planned flight: more like those there are, the same with an effect switched off and on by
turns, the same with a further sensor."""
BEYOND = 0.2
"""Share of a flight outside of what was flown from which it is marked as going beyond that."""


@dataclass(frozen=True)
class Suggestion:
    """One recording judged. `what`: the flight in words, the effect that is switched, or the column of the sensor;
    `chance`: that the right hypothesis is identified after RECORDS records; `records`: the fewest that are enough,
    inf where none are; `known`: whether it keeps to conditions that were flown."""

    kind: str
    what: str
    chance: float
    records: float
    flight: PlannedFlight | None = None
    known: bool = True

    @classmethod
    def from_outlook(
        cls, outlook: Outlook, kind: str, what: str = "", flight: PlannedFlight | None = None, known: bool = True
    ) -> Suggestion:
        return cls(kind, what, outlook.chance(RECORDS), outlook.records, flight, known)


def best_first(found: Iterable[Suggestion]) -> list[Suggestion]:
    """Soonest enough first; of those that RECORDS records are not enough of, likeliest after so many."""
    return sorted(found, key=lambda s: (min(s.records, RECORDS + 1.0), -s.chance, s.records))


def best_of_each_kind(found: Iterable[Suggestion]) -> list[Suggestion]:
    """The first of every kind of suggestions in their order."""
    best: dict[str, Suggestion] = {}
    for s in found:
        best.setdefault(s.kind, s)
    return list(best.values())


def is_inside_flown(flown: Mapping[str, np.ndarray], inputs: Mapping[str, np.ndarray]) -> bool:
    """Whether most of a flight lies within the ranges of what was flown, columns → (N,) each."""
    outside = np.zeros(len(next(iter(inputs.values()))), bool)
    for c, values in inputs.items():
        was = np.asarray(flown.get(c, values), float)
        outside |= (values < np.nanmin(was)) | (values > np.nanmax(was))
    return bool(outside.mean() <= BEYOND)
