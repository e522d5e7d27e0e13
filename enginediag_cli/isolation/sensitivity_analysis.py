"""Sensitivity of the conclusion: which single error, and how large, would put another answer first.

Errors are those of a map, of an instrument or of an input. An error acts as a parameter of the statistics does: an
instrument that reads wrong by a adds a ∂y/∂(its bias) to the readings, a map that is wrong by a where these records
were flown adds a ∂y/∂θ_q, as a change of the health parameter does that multiplies what the map gives. With
b ~ N(I Δθ, I) either moves the score by a I d, d being the unit vector of that parameter. A map error that is the same
where training was flown has been identified with the engine and moves nothing; meant is what differs between there and
here.

Stated size of a map error. Of the map quantity q with health parameter θ_q and amounts a_j the relative error at map
coordinates ξ is

    θ_q + Σ_j a_j φ_j(ξ)        of variance        (1, φ(ξ)) C_q|o (1, φ(ξ))ᵀ,      C_q|o = ((C⁻¹)_qq)⁻¹,

C the posterior covariance of everything uncertain, o all of it but the block of q: training knows what errors do to
readings together far better than which of them does it, and the question is about one error alone. The size is the root
of the mean variance over operating points of the window.

When the conclusion has changed: where another set leads, except for the error of the instrument that is tried. Where an
answer gets "and T3 reads wrong" by an error of T3, the conclusion is the same. A map error has no name of its own, so
that its component's health in the answer is a change. Nor has it changed where another set holds the answer and changes
that are too small to matter, as in the answer's own probability (`posterior.py`).

Posterior of sets while one error grows. With an error of size a along d the score is b + a I d, and with β = D b,
γ = D I d, D the widths of the prior, the marginal likelihood of a set S under the slab w is

    ½ (β + aγ)_Sᵀ P (β + aγ)_S + ½ log det P − |S| log w = c₀ + a c₁ + a² c₂,     P = (D I_SS D + w⁻²)⁻¹

so that comparing S with another set at any a takes three numbers of each; the factor of wear and bounds
(`slab_mixture.py`) is computed again where it may decide. All lines are searched abreast.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import hypot
from typing import Any

import numpy as np

from enginediag_cli.engine.instrument_errors import DRIFT
from enginediag_cli.error_model.maps import QUANTITIES, MapErrorModel
from enginediag_cli.isolation.diagnosis import (
    HALF,
    component_posterior,
    median_model,
)
from enginediag_cli.isolation.posterior import (
    SetInference,
    SetPosterior,
    absorb_small_changes,
    log_negligible_probability,
)
from enginediag_cli.isolation.prior import InstrumentForms, SetPrior, are_sensors
from enginediag_cli.isolation.subsets import FAINT, log_bound_factors, score_groups, slab_gaussians, wear_signs
from enginediag_cli.parameters import Parameter
from enginediag_cli.probability import log_mean
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.score import Score
from enginediag_cli.residuals.windows import WindowStatistics

HELD = 1e-10
"""Of the scaled covariance, so that what is known to rounding alone can be inverted; as in `Monitor.precision`."""


def map_error_sigmas(monitor: Monitor, flown: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Standard deviation of the error of each map quantity that is monitored, a share, by its health parameter, at
    operating points column -> (k,); empty where the model has no errors of maps or no point can be computed."""
    engine = monitor.engine
    if not isinstance(engine, MapErrorModel) or not flown:
        return {}
    frozen = engine.frozen(dict(flown), ())
    _, curves = engine.factors(frozen, ())
    seen = np.flatnonzero(curves.any(axis=(1, 2)))
    if not seen.size:
        return {}
    uncertain = np.flatnonzero(np.diag(monitor.uncertainty) > 0)
    place = {monitor.names[i]: k for k, i in enumerate(uncertain)}
    scale = np.sqrt(np.diag(monitor.uncertainty))[uncertain]
    C = monitor.uncertainty[np.ix_(uncertain, uncertain)] / scale / scale[:, None]
    precision = np.linalg.inv(C + HELD * np.eye(len(C)))
    found = {}
    for g, (target, amounts) in enumerate(engine.groups.items()):
        if target not in monitor.monitored or any(name not in place for name in (target, *amounts)):
            continue
        at = np.array([place[target], *(place[name] for name in amounts)])
        alone = np.linalg.inv(precision[np.ix_(at, at)])
        row = scale[at] * np.column_stack([np.ones(len(seen)), curves[seen, g]])
        found[target] = float(np.sqrt(np.mean(np.einsum("ni,ij,nj->n", row, alone, row))))
    return found


MAP, SENSOR, INPUT, PRIOR = "map", "sensor", "input", "prior"
"""Kinds of errors."""
SPREAD = "spread between recordings"
ACCURACY = "left open by training"
STATED = "stated accuracy"
PLAUSIBLE = "plausible error"
CHANGE = "plausible change"
PERCENT = 100.0
"""Per cent in one."""


@dataclass(frozen=True)
class StatedError:
    """One standard deviation that the error model allows an error, in the parameter's unit, and where it is from."""

    sigma: float
    origin: str


@dataclass(frozen=True)
class SingleError:
    """An error that acts as parameter number `position` of a score does. column: of the instrument, "" of a map; unit:
    of its size, "%" for shares; scale: the parameter's unit in one of these; stated: one standard
    deviation, in `unit`; reading: mean reading of the instrument in the column's unit, NaN where it is not known."""

    name: str
    kind: str
    position: int
    column: str
    unit: str
    scale: float
    stated: float
    origin: str
    reading: float = float("nan")


def single_errors(
    score: Score, stated: Mapping[str, StatedError], columns: Mapping[str, str], readings: Mapping[str, float]
) -> tuple[SingleError, ...]:
    """Errors whose effect the statistics of `score` hold. stated: parameter → how large its error is stated, without
    which it is what is plausible of the parameter; columns: parameter → column of its instrument; readings: column →
    mean reading."""
    found = []
    for i, p in enumerate(score.described):
        kind = SENSOR if p.belongs_to_sensor else INPUT if p.belongs_to_instrument else MAP
        if p.quantity == DRIFT or (kind == MAP and p.quantity not in QUANTITIES):
            continue
        own = stated.get(p.name) or StatedError(float(score.prior_sigma[i]), CHANGE if kind == MAP else PLAUSIBLE)
        share = p.unit in ("", "1") and (kind == MAP or p.quantity == "scale")
        scale = (abs(float(score.theta0[i])) or 1.0) / PERCENT if share else 1.0
        column = columns.get(p.name, "")
        unit = "%" if share else p.shown_unit
        reading = readings.get(column, float("nan"))
        found.append(SingleError(p.name, kind, i, column, unit, scale, own.sigma / scale, own.origin, reading))
    return tuple(found)


def instrument_columns(monitor: Monitor) -> dict[str, str]:
    """Parameter → column of the instrument whose error it is, of the monitored parameters."""
    engine: Any = monitor.engine
    described = {c: engine.sensors[c] for c in monitor.sensors if hasattr(engine.sensors.get(c), "parameters")}
    found = {p.name: c for c, sensor in described.items() for p in sensor.parameters()}
    found.update({name: error.column for name, error in getattr(engine, "errors", {}).items()})
    return {name: column for name, column in found.items() if name in monitor.monitored}


def stated_errors(
    monitor: Monitor, readings: Mapping[str, float], flown: Mapping[str, np.ndarray]
) -> dict[str, StatedError]:
    """How large errors are allowed where a window was flown: of maps by what training leaves open of them at operating
    points like those in `flown`, column -> (k,), of an instrument by how much recordings differ, its zero and, at its
    mean reading, its span."""
    found = {name: StatedError(sigma, ACCURACY) for name, sigma in map_error_sigmas(monitor, flown).items() if sigma}
    first = len(monitor.names) - len(monitor.offsets)
    spread: dict[str, dict[str, float]] = {}
    for k, offset in enumerate(monitor.offsets):
        column = offset.column or monitor.sensors[offset.sensor]
        if offset.kind in ("bias", "scale"):
            spread.setdefault(column, {})[offset.kind] = float(monitor.prior_sigma[first + k])
    for name, column in instrument_columns(monitor).items():
        own, reading = spread.get(column, {}), abs(readings.get(column, 0.0))
        zero, span = own.get("bias", 0.0), own.get("scale", 0.0)
        if monitor.meaning[name].quantity == "scale":
            sigma = hypot(span, zero / reading if reading else 0.0)
        else:
            sigma = hypot(zero, span * reading)
        if sigma:
            found[name] = StatedError(sigma, SPREAD)
    return found


LIKELY = 3e-3
"""Share of the answer's probability from which what wear does to a set was weighed for certain."""


@dataclass(frozen=True)
class _ScoreGroup:
    """Sets (their rows) that are read by one score, in widths of the prior: γ of each line (D, p)."""

    rows: np.ndarray
    score: Score
    moves: np.ndarray


class ErrorLines:
    """log posterior of M sets along D lines, up to a constant. masks (M, p) bool; log_prior (M,); lines (D, p): what
    an error of size one looks like, in units of the parameters; reported (M,): log probabilities of the sets as they
    were found, NaN of what was not, the first being known."""

    def __init__(
        self,
        belief: SetInference,
        masks: np.ndarray,
        log_prior: np.ndarray,
        lines: np.ndarray,
        reported: np.ndarray,
        *,
        leader_only: bool = False,
    ):
        self.leader_only = leader_only
        self.masks, self._prior = masks, belief.prior
        self._groups: list[_ScoreGroup] = []
        S, M, D = len(belief.prior.slabs), len(masks), len(lines)
        self._c0, self._c1, self._c2 = np.zeros((S, M)), np.zeros((S, M, D)), np.zeros((S, M, D))
        for rows, score in score_groups(masks, belief.score, belief.own_scores):
            widths = score.prior_sigma * self._prior.widths(score.described)
            self._groups.append(_ScoreGroup(rows, score, (lines @ score.information) * widths))
            self._expand(self._groups[-1])
        signs = wear_signs(belief.score, belief.prior)
        self._bounded = (masks & ~are_sensors(belief.score.described)).any(axis=1)
        self._most = np.log(2 * max(belief.prior.p_recovery, 1 - belief.prior.p_recovery))
        self._signed = (masks & (signs != 0)).sum(axis=1)
        self._constant = np.zeros(M)
        here = log_prior + self._log_mixture(np.zeros(1, int), np.zeros(1))[0]
        here = here + self._log_bound_factors(np.arange(M), 0, 0.0)
        # what was found for a set holds more than its quadratic says: of those that the full model was fitted to and
        # of likely ones; in others wear may not have been weighed, and they are as far apart as the answer is
        own = np.array([mask.tobytes() in belief.own_scores for mask in masks], bool)
        with np.errstate(invalid="ignore"):
            sure = np.isfinite(reported) & (own | (reported > reported[0] + np.log(LIKELY)))
        apart = np.where(sure, reported - here, reported[0] - here[0])
        self._constant = log_prior + apart

    def _expand(self, group: _ScoreGroup) -> None:
        b, _ = self._prior.scaled(group.score)
        for found in slab_gaussians(group.score, self.masks[group.rows], self._prior):
            rows, gamma = group.rows[found.rows], group.moves[:, found.members].transpose(1, 2, 0)  # (S, d, D)
            moved = found.covariance @ gamma
            self._c0[:, rows] = found.log
            self._c1[:, rows] = np.sum(b[found.members][..., None] * moved, axis=2)
            self._c2[:, rows] = 0.5 * np.sum(gamma * moved, axis=2)

    def _log_mixture(self, line: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Log posterior (n, M) at sizes a (n,) along lines number (n,), without what wear does."""
        size = a[:, None]
        slope, curvature = (np.moveaxis(c[:, :, line], 2, 1) for c in (self._c1, self._c2))
        return log_mean(self._c0[:, None, :] + size * slope + size**2 * curvature) + self._constant

    def _log_bound_factors(self, sets: np.ndarray, line: int | np.ndarray, a: float | np.ndarray) -> np.ndarray:
        """Log of what wear does to sets number (k,), each at its own size a along its own line."""
        found = np.zeros(len(sets))
        lines, sizes = np.broadcast_to(line, sets.shape), np.broadcast_to(a, sets.shape)
        group_of = np.empty(len(self.masks), int)
        for g, group in enumerate(self._groups):
            group_of[group.rows] = g
        for g, group in enumerate(self._groups):
            at = np.flatnonzero(group_of[sets] == g)
            if at.size:
                moved = sizes[at, None] * group.moves[lines[at]]
                own, of = np.unique(sets[at], return_inverse=True)
                found[at] = log_bound_factors(group.score, self.masks[own], self._prior, moved, of)
        return found

    def log_posterior(self, line: Sequence[int] | np.ndarray, a: np.ndarray) -> np.ndarray:
        """Log posterior (n, M) at sizes a (n,) along lines number (n,), up to a constant of each."""
        line = np.asarray(line, int)
        logs = self._log_mixture(line, a)
        ceiling = logs + self._most * self._signed
        least = ceiling.max(axis=1, keepdims=True) + np.log(FAINT)
        if self.leader_only:  # no set that stays behind the one with the highest ceiling can lead
            top = ceiling.argmax(axis=1)
            rows = np.arange(len(line))
            least = np.maximum(least, (logs[rows, top] + self._log_bound_factors(top, line, a))[:, None] - 1e-9)
        n, k = np.nonzero((ceiling > least) & self._bounded)
        logs[n, k] += self._log_bound_factors(k, line[n], a[n])
        return np.where(ceiling > least, logs, -np.inf) if self.leader_only else logs

    @property
    def standard_errors(self) -> np.ndarray:
        """Size (D,) of an error along each line that moves the score by one standard error."""
        group = self._groups[0]
        D = group.score.prior_sigma * self._prior.widths(group.score.described)
        with np.errstate(divide="ignore"):
            information = group.score.information * D * D[:, None]
            eigenvalues, vectors = np.linalg.eigh(information)
            seen = eigenvalues > 1e-9 * max(float(eigenvalues[-1]), 1e-300)
            along = group.moves @ vectors[:, seen]
            return np.asarray(1 / np.sqrt(np.sum(along**2 / eigenvalues[seen], axis=1)))


def log_set_prior(belief: SetInference, masks: np.ndarray) -> np.ndarray:
    """log P(S) (M,) of sets of parameters (M, p)."""
    return belief.prior.log_probability(masks, InstrumentForms.from_parameters(belief.score.described))


FIRST = 0.02
"""First size that is tried, in standard errors of the score: smaller ones change a log probability by nothing."""
GROWTH = 1.3
"""From one size that is tried to the next. A set that leads between two of them and at neither is passed over."""
HALVINGS = 9
"""Of such a step: the size is then known to half a thousandth of itself."""

Named = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""named(lines (n,), log posterior (n, M)) → number of the set that is named on each (n,)."""
Same = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""same(lines (n,), sizes (n,), sets (n,)) → (n,) whether a set, at this size along that line, is the answer under
another guise."""


@dataclass(frozen=True)
class Crossing:
    """Along line number `line` the name changes at `size`, with its sign, to set number `becomes`."""

    line: int
    size: float
    becomes: int


def find_crossings(lines: ErrorLines, named: Named, same: Same, most: np.ndarray) -> list[Crossing]:
    """The nearest crossing along each line, on either side of nothing; those beyond `most` (D,) are dropped."""
    D = len(most)
    line, sign = np.repeat(np.arange(D), 2), np.tile([1.0, -1.0], D)
    error = lines.standard_errors[line]
    limit = most[line]
    known = np.isfinite(error) & (limit > 0)
    line, sign, limit, low = line[known], sign[known], limit[known], np.zeros(int(known.sum()))
    high = np.minimum(FIRST * error[known], limit)
    found_low, found_high = np.full(len(line), np.nan), np.full(len(line), np.nan)
    waiting = np.arange(len(line))
    nearest = np.full(D, np.inf)
    while waiting.size:
        changed = ~_is_unchanged(lines, named, same, line[waiting], sign[waiting] * high[waiting])
        found_low[waiting[changed]], found_high[waiting[changed]] = low[waiting[changed]], high[waiting[changed]]
        np.minimum.at(nearest, line[waiting[changed]], high[waiting[changed]])
        waiting = waiting[~changed]
        waiting = waiting[(high[waiting] < limit[waiting]) & (high[waiting] < nearest[line[waiting]])]
        low[waiting] = high[waiting]
        high[waiting] = np.minimum(GROWTH * high[waiting], limit[waiting])
    at = np.flatnonzero(np.isfinite(found_high))
    if not at.size:
        return []
    line, sign, low, high = line[at], sign[at], found_low[at], found_high[at]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        stays = _is_unchanged(lines, named, same, line, sign * middle)
        low, high = np.where(stays, middle, low), np.where(stays, high, middle)
    becomes = named(line, lines.log_posterior(line, sign * high))
    found: dict[int, Crossing] = {}
    for k in np.argsort(-high, kind="stable"):  # the nearest of each line last
        found[int(line[k])] = Crossing(int(line[k]), float(sign[k] * high[k]), int(becomes[k]))
    return list(found.values())


def _is_unchanged(lines: ErrorLines, named: Named, same: Same, line: np.ndarray, a: np.ndarray) -> np.ndarray:
    return same(line, a, named(line, lines.log_posterior(line, a)))


MOST = 20.0
"""Standard deviations, as stated, up to which errors are tried: what takes more is no error but another instrument."""
LEADING = 150
"""Sets, likeliest first, that are followed along the lines; beside them all that differ from the answer by two
members."""


@dataclass(frozen=True)
class ConclusionChange:
    """An error that would change the conclusion.

    Attributes
    ----------
    name, kind : str
        The parameter whose error it is, and MAP, SENSOR, INPUT or PRIOR.
    size : float
        The smallest such error, with its sign, as it would be added to what is recorded; of prior odds the factor.
    unit : str
        Unit of `size` and `stated`.
    stated : float
        One standard deviation of this error as stated.
    conclusion : tuple of str
        What would be named first; empty for no change.
    error : SingleError or None
        None for a change of prior odds.
    """

    name: str
    kind: str
    size: float
    unit: str
    stated: float
    conclusion: tuple[str, ...]
    error: SingleError | None = None

    @property
    def times(self) -> float:
        """The size in stated standard deviations; of prior odds both are factors, whose logarithms count."""
        if self.kind == PRIOR:
            return float(np.log(self.size) / np.log(self.stated))
        return abs(self.size) / self.stated if self.stated else float("inf")


@dataclass(frozen=True)
class SensitivityAnalysis:
    """Sensitivity of a conclusion to single errors and to prior odds.

    Attributes
    ----------
    changes : tuple of ConclusionChange
        Errors that would change the conclusion, the smallest in stated standard deviations first.
    conclusion : tuple of str
        What is named now.
    tried : int
        Number of errors that were tried.
    most : float
        Largest size that was tried, in stated standard deviations.
    """

    changes: tuple[ConclusionChange, ...]
    conclusion: tuple[str, ...]
    tried: int
    most: float = MOST

    @classmethod
    def from_changes(
        cls, changes: Sequence[ConclusionChange], conclusion: tuple[str, ...], tried: int, most: float
    ) -> SensitivityAnalysis:
        return cls(tuple(sorted(changes, key=lambda change: change.times)), conclusion, tried, most)


def parameter_sensitivity(
    inference: SetInference, errors: Sequence[SingleError], most: float = MOST
) -> SensitivityAnalysis:
    """Which errors, of up to `most` stated standard deviations, would change the first set of parameters."""
    posterior, described = inference.posterior, inference.score.described
    forms = InstrumentForms.from_parameters(described)
    merged = posterior.merge_forms(forms)
    equal = (forms.merge_forms(posterior.masks, posterior.inclusion) == merged.masks[0]).all(axis=1)
    masks, reported = _sets_to_follow(posterior.masks, posterior.probabilities, int(np.flatnonzero(equal)[0]))
    possible = log_set_prior(inference, masks)
    kept = np.isfinite(possible) & (masks.sum(axis=1) <= posterior.largest)
    kept[0] = True
    masks, directions = masks[kept], _directions(errors, len(described))
    lines = ErrorLines(inference, masks, possible[kept], directions, reported[kept], leader_only=True)

    def likeliest(line: np.ndarray, logs: np.ndarray) -> np.ndarray:
        return np.asarray(logs.argmax(axis=1))

    negligible = _NegligibleDifference(inference, masks, directions)
    same = partial(_is_same_conclusion, _equal_up_to_instrument(masks, errors, described), negligible)
    changes = [
        _conclusion_change(errors[c.line], c.size, _names(posterior.parameters, masks[c.becomes]))
        for c in find_crossings(lines, likeliest, same, most * np.array([e.stated for e in errors]))
    ]
    answers = absorb_small_changes(inference.score, merged, inference.prior, inference.own_scores)
    if len(answers.probabilities) > 1 and answers.probabilities[1] > 0:
        odds = float(answers.probabilities[0] / answers.probabilities[1])
        changes.append(_prior_odds_change(odds, answers.names(1), inference.prior))
    return SensitivityAnalysis.from_changes(changes, answers.names(0), len(errors), most)


def component_sensitivity(
    score: Score, prior: SetPrior, errors: Sequence[SingleError], largest: int | None = None, most: float = MOST
) -> SensitivityAnalysis:
    """Which errors would change the components that `isolate_components` names of a score."""
    components, sets, probabilities, _ = component_posterior(score, prior, largest=largest)
    limit, owner = int(sets.sum(axis=1).max()), [p.component for p in score.described]
    members = np.array([[o == c for o in owner] for c in components], bool)
    firsts = [score.described[owner.index(c)] for c in components]
    answer = median_model(sets, probabilities)
    followed, reported = _sets_to_follow(sets, probabilities, answer)
    possible = prior.log_probability(followed, InstrumentForms.from_parameters(firsts))
    kept = np.isfinite(possible) & (followed.sum(axis=1) <= limit)
    followed, reported = followed[kept], reported[kept]
    masks = (followed[:, :, None] & members).any(axis=1)
    posterior = SetPosterior(score.parameters, masks, np.exp(reported), np.zeros(len(owner)), 0.0, limit)
    inference, directions = SetInference(score, posterior, prior), _directions(errors, len(owner))
    lines = ErrorLines(inference, masks, possible[kept], directions, reported)

    def named(line: np.ndarray, logs: np.ndarray) -> np.ndarray:
        return np.array([_median_set(followed, row) for row in logs], int)

    same = partial(_is_same_conclusion, _equal_up_to_instrument(masks, errors, score.described), None)
    changes = [
        _conclusion_change(errors[c.line], c.size, _names(components, followed[c.becomes]))
        for c in find_crossings(lines, named, same, most * np.array([e.stated for e in errors]))
    ]
    second = next((i for i in range(len(sets)) if i != answer), None)
    if second is not None and probabilities[second] > 0:
        odds = max(float(probabilities[answer] / probabilities[second]), 1.0)
        changes.append(_prior_odds_change(odds, _names(components, sets[second]), prior))
    return SensitivityAnalysis.from_changes(changes, _names(components, followed[0]), len(errors), most)


def _median_set(sets: np.ndarray, logs: np.ndarray) -> int:
    order = np.argsort(-logs, kind="stable")
    weights = np.exp(logs[order] - logs[order[0]])
    return int(order[median_model(sets[order], weights / weights.sum())])


def _sets_to_follow(masks: np.ndarray, probabilities: np.ndarray, answer: int) -> tuple[np.ndarray, np.ndarray]:
    """Of the sets (M, p) that of number `answer`, the most probable others and all that differ from it by one or two
    members, with the logarithms of their probabilities, NaN where they are not listed."""
    order = np.concatenate([[answer], np.delete(np.arange(len(masks)), answer)])
    masks, probabilities = masks[order], probabilities[order]
    with np.errstate(divide="ignore"):
        logs = {mask.tobytes(): float(log) for mask, log in zip(masks, np.log(probabilities), strict=True)}
    p = masks.shape[1]
    one = np.eye(p, dtype=bool)
    i, j = np.triu_indices(p, 1)
    near = masks[0] ^ np.concatenate([one, one[i] | one[j]])
    leading = masks[:LEADING]
    known = {mask.tobytes() for mask in leading}
    followed = np.concatenate([leading, [mask for mask in near if mask.tobytes() not in known] or leading[:0]])
    return followed, np.array([logs.get(mask.tobytes(), np.nan) for mask in followed])


def _directions(errors: Sequence[SingleError], p: int) -> np.ndarray:
    """The change of parameters (D, p) that each error of one, in its unit, looks like."""
    found = np.zeros((len(errors), p))
    for k, error in enumerate(errors):
        found[k, error.position] = error.scale
    return found


def _equal_up_to_instrument(
    masks: np.ndarray, errors: Sequence[SingleError], described: Sequence[Parameter]
) -> np.ndarray:
    """Whether each set (M,) is the first but for the instrument whose error is tried, of each error (D, M), and for the
    forms of other instruments' errors. described (p,): what each parameter is."""
    instruments = InstrumentForms.from_parameters(described)
    one = instruments.merge_forms(masks, np.ones(len(described)))
    apart = one ^ one[0]
    found = np.repeat(~apart.any(axis=1)[None], len(errors), axis=0)
    for k, error in enumerate(errors):
        if error.kind != MAP:
            others = np.array([p.component != described[error.position].component for p in described], bool)
            found[k] = ~apart[:, others].any(axis=1)
    return found


@dataclass(frozen=True)
class _NegligibleDifference:
    """Whether a set holds the first of `masks` (M, p) and beside it changes that are too small to matter, by the score
    with an error along one of `along` (D, p) in it."""

    belief: SetInference
    masks: np.ndarray
    directions: np.ndarray

    def __call__(self, line: int, size: float, other: int) -> bool:
        belief, d, mask = self.belief, size * self.directions[line], self.masks[other]
        if not np.all(mask | ~self.masks[0]):
            return False

        def moved(score: Score) -> Score:
            return replace(score, b=score.b + score.information @ d)

        own = belief.own_scores.get(mask.tobytes())
        about = {} if own is None else {mask.tobytes(): moved(own)}
        (log,) = log_negligible_probability(moved(belief.score), mask[None], belief.prior, about)
        return bool(np.sum(log[mask & ~self.masks[0]]) > np.log(HALF))


def _is_same_conclusion(
    cores: np.ndarray, small: _NegligibleDifference | None, line: np.ndarray, sizes: np.ndarray, sets: np.ndarray
) -> np.ndarray:
    found = np.array(cores[line, sets])
    if small is not None:
        for k in np.flatnonzero(~found):
            found[k] = small(int(line[k]), float(sizes[k]), int(sets[k]))
    return found


def _names(names: Sequence[str], mask: np.ndarray) -> tuple[str, ...]:
    return tuple(name for name, member in zip(names, mask, strict=True) if member)


def _conclusion_change(error: SingleError, size: float, conclusion: tuple[str, ...]) -> ConclusionChange:
    return ConclusionChange(error.name, error.kind, size, error.unit, error.stated, conclusion, error)


def _prior_odds_change(odds: float, conclusion: tuple[str, ...], prior: SetPrior) -> ConclusionChange:
    """The factor on the prior odds of the second conclusion against the first at which it comes first."""
    widest = max(*(max(s, 1 / s) for s in prior.odds_factors), 1.0)
    return ConclusionChange("prior odds", PRIOR, odds, "times", widest if widest > 1 else math.e, conclusion)


def window_errors(score: Score, window: WindowStatistics, monitor: Monitor | None) -> tuple[SingleError, ...]:
    """Errors to try, of maps and of all that gave a reading; without a monitor each has its plausible size."""
    if monitor is None:
        errors = single_errors(score, {}, {}, {})
    else:
        readings = {**window.conditions, **window.readings}
        stated = stated_errors(monitor, readings, window.sample_inputs)
        errors = single_errors(score, stated, instrument_columns(monitor), readings)
    return tuple(error for error in errors if error.name not in window.silent)
