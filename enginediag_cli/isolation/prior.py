"""What is known before the data: how many parameters change, and by how much.

Which: either separate faults, each parameter changed with probability π; or, with the small probability `worn`,
an engine that is worn, where any number of changed parameters is as probable as any other. How often faults come
together is not known beforehand: π is one of several, each as probable as the others, and the data say which. A set of
k of p parameters then has the probability

    P(S) = (1 − worn) mean over π of π^k (1 − π)^(p−k) + worn / ((p + 1) C(p, k)).

The first part alone would exclude an engine that is worn throughout, however clear the data (on multiplicity and
priors over the size of a set: Scott, J. G. and Berger, J. O. (2010) Annals of Statistics 38, 2587–2619).

Instruments, those of the model's inputs included, and valves do not wear together: each is wrong with a probability
of its own, c = `sensor` or `inclusion`, whatever the engine did, and no more than `max_sensor_faults` of them at once,
in one of its f forms (bias, scale, drift), all as probable, so that a set of parameters and of such as these has

    P(S) = P(parameters of S) · Π_{j in S} c_j/f_j · Π_{j not in S} (1 − c_j) / P(no more than wrong_sensors are wrong).

How much: a change of a parameter is N(0, slab² · prior_sigma²), where the slab is common to the parameters of a
set and one of `slabs`, each as probable as the others. With prior_sigma of 2 %, as health parameters have it, the
three widths stand for changes of about 0.3 %, 1 % and 3 %. What wear can only lower, as efficiencies, has risen with
the probability `rises` where it has changed: modules are repaired and exchanged. No change of a component goes beyond
RISE and REACH, none of an instrument beyond what a parameter states as its `reach`. Of an instrument the slab is
`instruments` times as wide. Its prior_sigma is a plausible bias, three times its noise, and what instruments differ by
from flight to flight is counted beside; one that is *wrong* is off by about half of that bias, by one and a half, or
by several. Narrower ones are not seen, so that records never speak against them, and a broken probe exceeds them by so
much that a change of the engine is found less improbable.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from enginediag_cli.parameters import INSTRUMENT, MOST_AT_ONCE, PARAMETER, Parameter
from enginediag_cli.probability import log_mean
from enginediag_cli.residuals.score import Score

RISE, REACH = 2.5, 12.5
"""What a component can do at most against its wear and else, in prior standard deviations: 5 % and 25 % where these are
2 %. A module that is restored gains no more than it had lost, and one that has lost a quarter does not run."""
SEPARATED = 0.9
"""Chance from which the form of an instrument's error is known: odds of nine to one, as of members of a class."""


def are_sensors(parameters: Sequence[Parameter]) -> np.ndarray:
    """Which parameters (p,) are errors of instruments, of a measured output or of an input."""
    return np.array([p.belongs_to_instrument for p in parameters], bool)


@dataclass(frozen=True)
class InstrumentForms:
    """Which parameters are forms of the error of which instrument or actuator: its number (p,), −1 of what wears with
    the engine. The forms of one instrument (its bias, scale, drift) exclude each other. valves: numbers of those that
    are actuators."""

    owner: np.ndarray
    valves: frozenset[int] = frozenset()

    @staticmethod
    def from_parameters(parameters: Sequence[Parameter]) -> InstrumentForms:
        kinds = {p.component: p.belongs_to_instrument for p in parameters if p.fails_alone}
        number = {name: k for k, name in enumerate(kinds)}
        return InstrumentForms(
            np.array([number[p.component] if p.fails_alone else -1 for p in parameters], int),
            frozenset(number[name] for name, instrument in kinds.items() if not instrument),
        )

    @staticmethod
    def single_form(sensors: np.ndarray) -> InstrumentForms:
        """Instruments of one form each, where `sensors` (p,) bool."""
        return InstrumentForms(np.where(sensors, np.cumsum(sensors) - 1, -1))

    @property
    def is_form(self) -> np.ndarray:
        """Whether each parameter (p,) is a form of an instrument's error."""
        return self.owner >= 0

    @property
    def count(self) -> int:
        return int(self.owner.max(initial=-1)) + 1

    @cached_property
    def forms(self) -> np.ndarray:
        """How many forms the error of each has (count,)."""
        return np.bincount(self.owner[self.is_form], minlength=self.count)

    def log_forms(self, masks: np.ndarray, log_each: np.ndarray) -> np.ndarray:
        """Sum (M,) of log_each (p,) over the forms in sets (M, p); −inf of a set with two forms of one instrument."""
        found = np.zeros(len(masks))
        for i in np.flatnonzero(self.is_form):
            found[masks[:, i]] += log_each[i]
        for k in np.flatnonzero(self.forms > 1):
            found[masks[:, self.owner == k].sum(axis=1) > 1] = -np.inf
        return np.asarray(found)

    def inclusion(self, of_forms: np.ndarray) -> np.ndarray:
        """Chance (p,) that each parameter changed, of an instrument's that it is wrong in any form; of_forms (p,): of
        each form by itself."""
        total = np.bincount(self.owner[self.is_form], weights=of_forms[self.is_form], minlength=self.count)
        found = of_forms.copy()
        found[self.is_form] = total[self.owner[self.is_form]]
        return np.minimum(found, 1.0)

    def shares(self, names: Sequence[str], chosen: Sequence[str], of_forms: np.ndarray) -> dict[str, dict[str, float]]:
        """Of each instrument among the `chosen` parameters, of `names` (p,), the chance of each form of its error,
        given that it is wrong; none of instruments of one form. of_forms (p,): chance of each form."""
        total, place = self.inclusion(of_forms), {name: i for i, name in enumerate(names)}
        found = {}
        for name in chosen:
            owner = self.owner[place[name]]
            mine = np.flatnonzero(self.owner == owner).tolist()
            if owner >= 0 and len(mine) > 1:
                found[name] = {names[i]: float(of_forms[i] / total[i]) for i in mine}
        return found

    def merge_forms(self, masks: np.ndarray, of_forms: np.ndarray) -> np.ndarray:
        """The sets (M, p) with every wrong instrument in its likeliest form, or in its usual one, the first, where that
        is not likelier by nine to one; of_forms (p,): chance of each form."""
        found = masks.copy()
        for k in range(self.count):
            mine = np.flatnonzero(self.owner == k)
            best = int(np.argmax(of_forms[mine]))
            form = best if of_forms[mine[best]] >= SEPARATED * of_forms[mine].sum() else 0
            found[:, mine] = False
            found[:, mine[form]] = masks[:, mine].any(axis=1)
        return found


@dataclass(frozen=True)
class SetPrior:
    """What is known before the data. This is the one place of the priors of isolation: of windows here, of a series
    and of a fault catalogue in `SeriesPrior` and `CataloguePrior` below.

    Attributes
    ----------
    inclusion, sensor : float
        Probability that a parameter changed, and that an instrument is wrong (`parameters.py`).
    p_uniform_wear : float
        Probability of an engine on which any number of changes is equally probable.
    slabs : tuple of float
        Standard deviations of a change, in prior_sigma, equally probable.
    max_sensor_faults : int
        Most instruments and valves that are wrong at once.
    odds_factors : tuple of float
        Factors on the odds of `inclusion`, equally probable.
    p_recovery : float
        Probability that a parameter that changed moved against its wear; 0.5 where nothing is known of that.
    instrument_width : float
        Factor on the slabs for errors of instruments.
    """

    inclusion: float = PARAMETER
    p_uniform_wear: float = 0.05
    slabs: tuple[float, ...] = (0.15, 0.5, 1.5)
    sensor: float = INSTRUMENT
    max_sensor_faults: int = MOST_AT_ONCE
    odds_factors: tuple[float, ...] = (0.5, 1.0, 2.0)
    p_recovery: float = 0.05
    instrument_width: float = 3.0

    def __post_init__(self) -> None:
        if not 0 < self.inclusion < 1:
            raise ValueError("`inclusion` must lie between 0 and 1")
        if not 0 <= self.p_uniform_wear <= 1:
            raise ValueError("`p_uniform_wear` must lie in [0, 1]")
        if not 0 < self.sensor < 1 or self.max_sensor_faults < 0:
            raise ValueError("`sensor` must lie between 0 and 1, and `max_sensor_faults` not be negative")
        if not 0 < self.p_recovery < 1:
            raise ValueError("`p_recovery` must lie between 0 and 1")
        if not 0 < self.instrument_width < np.inf:
            raise ValueError("`instrument_width` must be positive and finite")
        if not self.odds_factors or not all(0 < factor < np.inf for factor in self.odds_factors):
            raise ValueError("`odds_factors` must be positive and finite, one at least")
        if not self.slabs or not all(0 < slab < np.inf for slab in self.slabs):
            raise ValueError("`slabs` must be positive and finite, one at least")

    @property
    def change_probabilities(self) -> np.ndarray:
        """π of separate faults (n,), each as probable as the others."""
        odds = self.inclusion / (1 - self.inclusion) * np.asarray(self.odds_factors)
        return np.asarray(odds / (1 + odds))

    def widths(self, parameters: Sequence[Parameter]) -> np.ndarray:
        """Size (p,) of a change by one slab, in prior_sigma of each parameter."""
        return np.where(are_sensors(parameters), self.instrument_width, 1.0)

    def bounds(self, parameters: Sequence[Parameter]) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest change (p,) that is possible, in prior_sigma of each parameter; where nothing is known of
        rises (a repair, a difference of levels) as far up as down."""
        wear = np.array([p.wear if self.p_recovery != 0.5 else 0 for p in parameters])
        reach = np.array([p.reach if p.belongs_to_instrument else REACH for p in parameters])
        return np.where(wear > 0, -RISE, -reach), np.where(wear < 0, RISE, reach)

    def scaled(self, score: Score) -> tuple[np.ndarray, np.ndarray]:
        """Score (p,) and information (p, p) of changes in these `widths`."""
        b, information = score.scaled()
        wide = self.widths(score.described)
        return wide * b, wide[:, None] * information * wide

    def log_size_probability(self, p: int) -> np.ndarray:
        """log P(S) (p + 1,) of one set of each size 0…p among p parameters."""
        from scipy.special import betaln

        k = np.arange(p + 1)
        each = k[:, None] * np.log(self.change_probabilities) + (p - k)[:, None] * np.log1p(-self.change_probabilities)
        separate = log_mean(each, axis=1)
        with np.errstate(divide="ignore"):
            # 1/((p + 1) C(p, k)) = B(1 + k, 1 + p − k)
            return np.asarray(
                np.logaddexp(
                    np.log1p(-self.p_uniform_wear) + separate, np.log(self.p_uniform_wear) + betaln(1 + k, 1 + p - k)
                )
            )

    def fault_probabilities(self, instruments: InstrumentForms) -> np.ndarray:
        """Probability (count,) that each instrument or valve is wrong."""
        return np.array([self.inclusion if k in instruments.valves else self.sensor for k in range(instruments.count)])

    def log_fault_odds(self, instruments: InstrumentForms) -> np.ndarray:
        """log odds (p,) of each form of an instrument's or a valve's fault; 0 of what wears with the engine."""
        if not instruments.count:
            return np.zeros(len(instruments.owner))
        c = self.fault_probabilities(instruments)
        odds = np.log(c / (1 - c) / np.maximum(instruments.forms, 1))
        return np.where(instruments.is_form, odds[instruments.owner], 0.0)

    def log_no_instrument_fault(self, instruments: InstrumentForms) -> float:
        """log probability that none of them is wrong, given that no more than `max_sensor_faults` are."""
        c = self.fault_probabilities(instruments)
        odds = np.zeros(self.max_sensor_faults + 1)  # of each number of wrong ones against none
        odds[0] = 1.0
        for x in c / (1 - c):
            odds[1:] += x * odds[:-1]
        return -float(np.log(odds.sum()))

    def log_probability(self, masks: np.ndarray, instruments: InstrumentForms) -> np.ndarray:
        """log P(S) (M,) of sets (M, p) bool."""
        forms = instruments.is_form
        size, wrong = (masks & ~forms).sum(axis=1), (masks & forms).sum(axis=1)
        log = self.log_size_probability(int(np.sum(~forms)))[size] + self.log_no_instrument_fault(instruments)
        log = log + instruments.log_forms(masks, self.log_fault_odds(instruments))
        return np.where(wrong <= self.max_sensor_faults, log, -np.inf)

    def draw(
        self,
        rng: np.random.Generator,
        count: int,
        p: int,
        instruments: InstrumentForms | None = None,
        wear: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """`count` engines from this prior: which changed (count, p) bool, by how many prior_sigma (count, p).

        instruments: which parameters are errors of instruments; wear (p,): way on which wear takes each, 0 where both.
        """
        # a chance that is itself uniform makes all numbers of changes equally probable
        separate = rng.choice(self.change_probabilities, size=count)
        chance = np.where(rng.random(count) < self.p_uniform_wear, rng.random(count), separate)
        changed = rng.random((count, p)) < chance[:, None]
        if instruments is not None and instruments.count:
            wrong = np.zeros((count, instruments.count), bool)
            again = np.arange(count)
            while again.size:
                wrong[again] = rng.random((len(again), instruments.count)) < self.fault_probabilities(instruments)
                again = again[wrong[again].sum(axis=1) > self.max_sensor_faults]
            for k in range(instruments.count):
                mine = np.flatnonzero(instruments.owner == k)
                form = rng.integers(len(mine), size=count)
                changed[:, mine] = wrong[:, k, None] & (form[:, None] == np.arange(len(mine)))
        slab = rng.choice(np.asarray(self.slabs), size=(count, 1))
        size = slab * rng.standard_normal((count, p))
        if instruments is not None:
            size = np.where(instruments.is_form, self.instrument_width * size, size)
        if wear is not None and np.any(wear):
            way = np.where(rng.random((count, p)) < self.p_recovery, -wear, wear)
            size = np.where(wear == 0, size, way * np.abs(size))
        return changed, np.where(changed, size, 0.0)


@dataclass(frozen=True)
class SeriesPrior:
    """What is known before the data of a change during a series, beside the probabilities and slabs of `SetPrior`.

    Attributes
    ----------
    p_step : dict of bool to float
        Probability that an instrument (True) and a component (False) changes at once and does not grow. A thermocouple
        breaks or is replaced, few drift; most components wear and foul, the rest
        stands for damage, washing and overhaul. Valves leak as seals wear, and stick; as often as a component is
        damaged, so that neither passes for the other by this. Judgement.
    p_recovery : float
        Probability that a value which wear can move one way only has moved the other: twice that of one window, since
        a series spans washing and overhaul.
    instrument_slab : float
        Largest slab of an instrument: its prior standard deviation is how far it plausibly is off when it is wrong.
    failed_slab : float
        Slab of an output sensor that has failed, beside the others: a broken thermocouple reads anything.
    """

    p_step: Mapping[bool, float] = field(default_factory=lambda: {True: 0.9, False: 0.05})
    p_recovery: float = 2 * SetPrior.p_recovery
    instrument_slab: float = 1.0
    failed_slab: float = 10.0


SERIES_PRIOR = SeriesPrior()


@dataclass(frozen=True)
class CataloguePrior:
    """What is known before the data of the faults of a catalogue.

    Attributes
    ----------
    presence : float
        Probability of each fault: half of that of a parameter, of whose changes a catalogue names some.
        Judgement.
    unlisted : float
        Probability that a change is not in the catalogue.
    scales : tuple of float
        Scales of the severity, equally probable; 1 is the catalogue's size.
    ratio_spread : float
        Factor by which the ratios within a fault may differ from the catalogue's.
    """

    presence: float = SetPrior.inclusion / 2
    unlisted: float = 0.2
    scales: tuple[float, ...] = (0.3, 1.0, 3.0)
    ratio_spread: float = 1.7


DEFAULT_CATALOGUE_PRIOR = CataloguePrior()
