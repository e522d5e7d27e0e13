"""What is known before the data: how many parameters change, and by how much.

Which: either separate faults, each parameter changed with probability π; or, with the small probability `worn`,
an engine that is worn, where any number of changed parameters is as probable as any other. How often faults come
together is not known beforehand: π is one of several, each as probable as the others, and the data say which. A set of
k of p parameters then has the probability

    P(S) = (1 − worn) mean over π of π^k (1 − π)^(p−k) + worn / ((p + 1) C(p, k)).

The first part alone would exclude an engine that is worn throughout, however clear the data (on multiplicity and
priors over the size of a set: Scott, J. G. and Berger, J. O. (2010) Annals of Statistics 38, 2587–2619).

Instruments, those of the model's inputs included, and valves do not wear together: each is wrong with a probability
of its own, c = `sensor` or `inclusion`, whatever the engine did, and no more than `wrong_sensors` of them at once, in
one of its f forms (bias, scale, drift), all as probable, so that a set of parameters and of such as these has

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

What wear and physics do to the probability of a set: efficiencies seldom rise, and nothing goes beyond bounds.

The slab prior of a change lies within what a component or an instrument can do (`SetPrior.bounds`); of one that wear
can only make one way 1 − ρ of the mass lies there and ρ, for exchanged and repaired modules, on the other side.
Relative to the unbounded symmetric prior the marginal likelihood of a set changes by the factor

    E[Π_i h_i(x_i) | S, slab, data],     h_i = (1 − ρ)/P(0 < s x < bound) on the way of wear,
                                              ρ/P(0 < −s x < bound) on the other, 0 beyond either bound

over the parameters i of S that have bounds, with the sign s of their wear (ρ = ½ where both ways are as probable),
where x | S, slab, data ~ N(P β, P), averaged over slabs by their posterior. The expectation is taken parameter by
parameter: the others are carried on with the first two moments of the one that was weighed, as if they were Gaussian
still (Mendell, N. R. and Elston, R. C. (1974) Biometrics 30, 41–57). That is exact for one parameter and for
independent ones, and costs no integral.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from enginediag_cli.faults.chances import INSTRUMENT, MOST_AT_ONCE, PARAMETER
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.score import Score

RISE, REACH = 2.5, 12.5
"""What a component can do at most against its wear and else, in prior standard deviations: 5 % and 25 % where these are
2 %. A module that is restored gains no more than it had lost, and one that has lost a quarter does not run."""
SEPARATED = 0.9
"""Chance from which the form of an instrument's error is known: odds of nine to one, as of members of a class."""


def are_sensors(parameters: Sequence[Parameter]) -> np.ndarray:
    """Which parameters (p,) are errors of instruments, of a measured output or of an input."""
    return np.array([p.of_instrument for p in parameters], bool)


@dataclass(frozen=True)
class Instruments:
    """Which parameters are forms of the error of which instrument or actuator: its number (p,), −1 of what wears with
    the engine. The forms of one instrument (its bias, scale, drift) exclude each other. valves: numbers of those that
    are actuators."""

    owner: np.ndarray
    valves: frozenset[int] = frozenset()

    @staticmethod
    def from_parameters(parameters: Sequence[Parameter]) -> Instruments:
        kinds = {p.component: p.of_instrument for p in parameters if p.fails_alone}
        number = {name: k for k, name in enumerate(kinds)}
        return Instruments(
            np.array([number[p.component] if p.fails_alone else -1 for p in parameters], int),
            frozenset(number[name] for name, instrument in kinds.items() if not instrument),
        )

    @staticmethod
    def alone(sensors: np.ndarray) -> Instruments:
        """Instruments of one form each, where `sensors` (p,) bool."""
        return Instruments(np.where(sensors, np.cumsum(sensors) - 1, -1))

    @property
    def forms_of(self) -> np.ndarray:
        """Whether each parameter (p,) is a form of an instrument's error."""
        return self.owner >= 0

    @property
    def count(self) -> int:
        return int(self.owner.max(initial=-1)) + 1

    @cached_property
    def forms(self) -> np.ndarray:
        """How many forms the error of each has (count,)."""
        return np.bincount(self.owner[self.forms_of], minlength=self.count)

    def log_forms(self, masks: np.ndarray, log_each: np.ndarray) -> np.ndarray:
        """Sum (M,) of log_each (p,) over the forms in sets (M, p); −inf of a set with two forms of one instrument."""
        found = np.zeros(len(masks))
        for i in np.flatnonzero(self.forms_of):
            found[masks[:, i]] += log_each[i]
        for k in np.flatnonzero(self.forms > 1):
            found[masks[:, self.owner == k].sum(axis=1) > 1] = -np.inf
        return np.asarray(found)

    def inclusion(self, of_forms: np.ndarray) -> np.ndarray:
        """Chance (p,) that each parameter changed, of an instrument's that it is wrong in any form; of_forms (p,): of
        each form by itself."""
        total = np.bincount(self.owner[self.forms_of], weights=of_forms[self.forms_of], minlength=self.count)
        found = of_forms.copy()
        found[self.forms_of] = total[self.owner[self.forms_of]]
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

    def in_one_form(self, masks: np.ndarray, of_forms: np.ndarray) -> np.ndarray:
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
    """inclusion, worn and sensor: probabilities, with the reasons in `faults/chances.py`; slabs: sizes of a change, in
    prior_sigma; wrong_sensors: instruments and valves at most, at once; spread: factors on the odds of inclusion, which
    give the π; rises: chance that a parameter that changed went against its wear, 0.5 where nothing is known of that;
    instruments: by how much slabs are wider for instruments' errors.
    """

    inclusion: float = PARAMETER
    worn: float = 0.05
    slabs: tuple[float, ...] = (0.15, 0.5, 1.5)
    sensor: float = INSTRUMENT
    wrong_sensors: int = MOST_AT_ONCE
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

    def bounds(self, parameters: Sequence[Parameter]) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest change (p,) that is possible, in prior_sigma of each parameter; where nothing is known of
        rises (a repair, a difference of levels) as far up as down."""
        wear = np.array([p.wear if self.rises != 0.5 else 0 for p in parameters])
        reach = np.array([p.reach if p.of_instrument else REACH for p in parameters])
        return np.where(wear > 0, -RISE, -reach), np.where(wear < 0, RISE, reach)

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

    def chances_of(self, instruments: Instruments) -> np.ndarray:
        """Probability (count,) that each instrument or valve is wrong."""
        return np.array([self.inclusion if k in instruments.valves else self.sensor for k in range(instruments.count)])

    def log_odds_of(self, instruments: Instruments) -> np.ndarray:
        """log odds (p,) of each form of an instrument's or a valve's fault; 0 of what wears with the engine."""
        if not instruments.count:
            return np.zeros(len(instruments.owner))
        c = self.chances_of(instruments)
        odds = np.log(c / (1 - c) / np.maximum(instruments.forms, 1))
        return np.where(instruments.forms_of, odds[instruments.owner], 0.0)

    def log_all_right(self, instruments: Instruments) -> float:
        """log probability that none of them is wrong, given that no more than `wrong_sensors` are."""
        c = self.chances_of(instruments)
        odds = np.zeros(self.wrong_sensors + 1)  # of each number of wrong ones against none
        odds[0] = 1.0
        for x in c / (1 - c):
            odds[1:] += x * odds[:-1]
        return -float(np.log(odds.sum()))

    def log_of(self, masks: np.ndarray, instruments: Instruments) -> np.ndarray:
        """log P(S) (M,) of sets (M, p) bool."""
        forms = instruments.forms_of
        size, wrong = (masks & ~forms).sum(axis=1), (masks & forms).sum(axis=1)
        log = self.log_of_size(int(np.sum(~forms)))[size] + self.log_all_right(instruments)
        log = log + instruments.log_forms(masks, self.log_odds_of(instruments))
        return np.where(wrong <= self.wrong_sensors, log, -np.inf)

    def draw(
        self,
        rng: np.random.Generator,
        count: int,
        p: int,
        instruments: Instruments | None = None,
        wear: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """`count` engines from this prior: which changed (count, p) bool, by how many prior_sigma (count, p).

        instruments: which parameters are errors of instruments; wear (p,): way on which wear takes each, 0 where both.
        """
        # a chance that is itself uniform makes all numbers of changes equally probable
        separate = rng.choice(self.chances, size=count)
        chance = np.where(rng.random(count) < self.worn, rng.random(count), separate)
        changed = rng.random((count, p)) < chance[:, None]
        if instruments is not None and instruments.count:
            wrong = np.zeros((count, instruments.count), bool)
            again = np.arange(count)
            while again.size:
                wrong[again] = rng.random((len(again), instruments.count)) < self.chances_of(instruments)
                again = again[wrong[again].sum(axis=1) > self.wrong_sensors]
            for k in range(instruments.count):
                mine = np.flatnonzero(instruments.owner == k)
                form = rng.integers(len(mine), size=count)
                changed[:, mine] = wrong[:, k, None] & (form[:, None] == np.arange(len(mine)))
        slab = rng.choice(np.asarray(self.slabs), size=(count, 1))
        size = slab * rng.standard_normal((count, p))
        if instruments is not None:
            size = np.where(instruments.forms_of, self.instruments * size, size)
        if wear is not None and np.any(wear):
            way = np.where(rng.random((count, p)) < self.rises, -wear, wear)
            size = np.where(wear == 0, size, way * np.abs(size))
        return changed, np.where(changed, size, 0.0)


WEIGHED = 300
"""Sets that are weighed at once, those first that could be likeliest: in the others signs and bounds are as right as
before the data."""
BATCHES = 10
"""Times so many are weighed: where the likeliest are all beyond what is possible, others lead."""
FAINT = 1e-4
"""Of what the likeliest could weigh; sets that could weigh less are not weighed. All that changes no stated probability
by more than 0.002."""


def log_wear(score: Score, masks: np.ndarray, logs: np.ndarray, prior: SetPrior) -> np.ndarray:
    """Log factors (M,) of sets (M, p) whose log weights without them are `logs` (M,); 0 of what is not weighed, and of
    what is left when BATCHES were weighed no more than of those."""
    bounded = np.isfinite(prior.bounds(score.described)[1])
    found = np.zeros(len(masks))
    if not bounded.any() or not len(masks):
        return found
    most = np.log(2 * max(prior.rises, 1 - prior.rises))
    ceiling = logs + most * (masks & (wear_signs(score, prior) != 0)).sum(axis=1)
    order = np.argsort(-ceiling, kind="stable")
    best, weighed = -np.inf, 0
    for _ in range(BATCHES):
        top = order[weighed : weighed + WEIGHED]
        top = top[ceiling[top] > max(best, ceiling[order[0]] + np.log(FAINT) if weighed == 0 else best + np.log(FAINT))]
        if not len(top):
            return found
        found[top] = log_factors(score, masks[top], prior)
        best = max(best, float((logs + found)[top].max()))
        weighed += len(top)
        if weighed >= len(order) or ceiling[order[weighed]] <= best + np.log(FAINT):
            return found
    found[order[weighed:]] = min(float(found[order[:weighed]].min()), 0.0)
    return found


def wear_signs(score: Score, prior: SetPrior) -> np.ndarray:
    """Way (p,) on which wear takes each parameter, −1 or +1, 0 where both are as probable."""
    known = prior.rises != 0.5
    return np.array([p.wear if known else 0 for p in score.described], float)


def log_factors(
    score: Score,
    masks: np.ndarray,
    prior: SetPrior,
    moved: np.ndarray | None = None,
    of: np.ndarray | None = None,
) -> np.ndarray:
    """Log factor (w,) by which wear and bounds change the marginal likelihood of each set (w, p) bool.

    moved (r, p): what is added to the score, in widths of the prior, and of (r,): to which of the sets; the factors are
    then (r,), one for each.
    """
    b, information = prior.scaled(score)
    slabs = np.asarray(prior.slabs, float)[:, None]
    which = np.arange(len(masks)) if of is None else of
    pulls = np.broadcast_to(b, masks.shape) if moved is None else b + moved
    factors = np.zeros(len(which))
    signs, widths = wear_signs(score, prior), prior.widths(score.described)
    low, high = (end / widths for end in prior.bounds(score.described))
    bounded = np.isfinite(high)
    sizes, counts = masks.sum(axis=1), (masks & bounded).sum(axis=1)
    for size, count in np.unique(np.column_stack([sizes, counts])[counts > 0], axis=0):
        rows = np.flatnonzero((sizes == size) & (counts == count))
        sets = np.nonzero(masks[rows])[1].reshape(len(rows), size)
        sets = np.take_along_axis(sets, np.argsort(~bounded[sets], axis=1, kind="stable"), 1)  # bounded ones first
        A = np.eye(size) + slabs[..., None, None] ** 2 * information[sets[:, :, None], sets[:, None, :]]
        covariance = np.linalg.inv(A)
        log_det = 0.5 * np.linalg.slogdet(covariance)[1]
        place = np.full(len(masks), -1)
        place[rows] = np.arange(len(rows))
        told = np.flatnonzero(place[which] >= 0)
        at = place[which[told]]
        members, covariance = sets[at], covariance[:, at]
        right = slabs[..., None] * np.take_along_axis(pulls[told], members, 1)
        mean = np.einsum("wsij,wsj->wsi", covariance, right)
        log = 0.5 * np.sum(mean * right, axis=2) + log_det[:, at]
        share = log - np.logaddexp.reduce(log, axis=0)
        cut = [np.broadcast_to(x[members], mean.shape).reshape(-1, size)[:, :count] for x in (signs, low, high)]
        unit = np.broadcast_to(slabs[..., None], mean.shape).reshape(-1, size)[:, :count]
        each = _log_expected(
            mean.reshape(-1, size),
            covariance.reshape(-1, size, size),
            cut[0],
            cut[1] / unit,
            cut[2] / unit,
            prior.rises,
        )
        factors[told] = np.logaddexp.reduce(share + each.reshape(share.shape), axis=0)
    return factors


def _log_expected(
    mean: np.ndarray, covariance: np.ndarray, signs: np.ndarray, low: np.ndarray, high: np.ndarray, rises: float
) -> np.ndarray:
    """Log of the expectation (w,) of Gaussians, mean (w, d), covariance (w, d, d), over the first k of their variables,
    whose signs, lowest and highest values are (w, k)."""
    from scipy.special import ndtr

    mean, covariance = mean.copy(), covariance.copy()
    total = np.zeros(len(mean))
    for i in range(signs.shape[1]):
        sign = signs[:, i]
        up = np.where(sign > 0, 1 - rises, np.where(sign < 0, rises, 0.5)) / (ndtr(high[:, i]) - 0.5)
        down = np.where(sign < 0, 1 - rises, np.where(sign > 0, rises, 0.5)) / (0.5 - ndtr(low[:, i]))
        spread = np.sqrt(covariance[:, i, i])
        a, c, z = ((x - mean[:, i]) / spread for x in (low[:, i], np.zeros(len(mean)), high[:, i]))
        log, moved, square = piecewise(a, c, z, down, up)
        total += log
        along = covariance[:, :, i] / spread[:, None]
        mean += along * moved[:, None]
        covariance += (square - moved**2 - 1.0)[:, None, None] * along[:, :, None] * along[:, None, :]
        # of the variable itself nothing but what is within the bounds is left: keep the matrix definite
        covariance[:, i, i] = np.maximum(covariance[:, i, i], 1e-12 * spread**2)
    return total


def piecewise(
    a: np.ndarray, c: np.ndarray, z: np.ndarray, down: np.ndarray, up: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Log of the mass, mean and mean square (w,) of a standard normal variable with the weight `down` from a to c and
    `up` from c to z, 0 beyond."""
    below, above = np.log(down) + log_mass(a, c), np.log(up) + log_mass(c, z)
    total = np.logaddexp(below, above)
    density = [-0.5 * x**2 - 0.5 * np.log(2 * np.pi) for x in (a, c, z)]
    at_a, at_c = (np.exp(np.log(down) + density[k] - total) for k in (0, 1))
    to_c, to_z = (np.exp(np.log(up) + density[k] - total) for k in (1, 2))
    mean = at_a - at_c + to_c - to_z
    low, high = np.where(np.isfinite(a), a, 0.0), np.where(np.isfinite(z), z, 0.0)  # no density so far out
    square = 1.0 + low * at_a - c * at_c + c * to_c - high * to_z
    # far beyond a bound rounding decides: all of the mass lies at it
    at = np.where(a > FAR, a, np.where(z < -FAR, z, np.nan))
    mean = np.where(np.isfinite(at), at, mean)
    square = np.where(np.isfinite(at), at**2, np.maximum(square, mean**2))
    return total, mean, square


FAR = 30.0
"""Standard deviations beyond a bound from which what is left of the normal law is a point there."""


def log_mass(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """log of the mass (w,) of the standard normal law between `low` and `high`, however far out."""
    from scipy.special import log_ndtr

    flip = low > 0
    one, other = np.where(flip, -high, low), np.where(flip, -low, high)
    upper, lower = log_ndtr(other), log_ndtr(one)
    return np.asarray(upper + np.log(np.maximum(-np.expm1(np.minimum(lower - upper, -1e-300)), 1e-300)))
