"""The health of an engine over its flights, instruments' errors aside: what margins and forecasts are made of.

    θ_t = Σ_i a_i g_i(t) + w(t) + Σ_e r_e 1[t ≥ t_e]      (of components)

a_i: the events as found, with their doubts, those of instruments beside them; w: a free smooth change of each health
parameter, a Brownian motion whose size is weighed by its evidence, since a component may have worn by what is no
event yet; r_e: what maintenance may have moved. All of it is one Gaussian, given the events: level and covariance per
flight, and what each maintenance changed.

`knots` are the same flights without the prior of a course, for a forecast that fits a law of growth to them: the
health of each stretch of flights by itself, with the covariance of its errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.history.background import Background, inner, nominal_basis, wander_modes
from enginediag_cli.history.records import History

FREE_SIZES = (0.03, 0.1, 0.3)
"""Standard deviation of the free change at the end, in prior ones: hardly, as much as is no event yet in a few flights,
and what is seen as an event otherwise."""
FREE_WEIGHTS = (0.5, 0.3, 0.2)
"""Probability of each before the flights are seen, as of instruments that wander."""
RESTORED = 0.5
"""Standard deviation of what maintenance moves beside what the events say, in prior ones: half of a change."""
KNOTS = 24
"""Stretches of flights of a forecast at most: a law of growth has three free numbers, and each takes a few."""
OPEN, CLOSED = 2.0, FREE_SIZES[-1]
"""Standard deviation of health of a stretch beforehand, in prior ones, of what changed by the events and of what did
not: hardly more than the flights themselves say, and what is no event."""


@dataclass(frozen=True)
class HealthStep:
    """What maintenance before epoch `epoch`, from 0, changed: level (q,) before it, change (q,) with its covariance
    (q, q), in the parameters' units."""

    epoch: int
    before: np.ndarray
    change: np.ndarray
    covariance: np.ndarray

    def select(self, at: Sequence[int]) -> HealthStep:
        """Of the parameters at positions `at` (k,) alone."""
        return HealthStep(self.epoch, self.before[at], self.change[at], self.covariance[np.ix_(at, at)])


@dataclass(frozen=True)
class HealthPath:
    """Health parameters over T epochs, in their units.

    level (T, q), covariance (T, q, q): what changed since the first; total (T, q), total_covariance (T, q, q): from
    nominal, with the engine's own level where it has one; steps: of each maintenance; knots (E,): first epoch of each
    stretch of a forecast; stretch (E q,), stretch_covariance (E q, E q): health of each by itself and its errors.
    """

    parameters: tuple[str, ...]
    level: np.ndarray
    covariance: np.ndarray
    total: np.ndarray
    total_covariance: np.ndarray
    steps: tuple[HealthStep, ...]
    knots: np.ndarray
    stretch: np.ndarray
    stretch_covariance: np.ndarray

    def project_level(self, slope: np.ndarray, *, total: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (T,) of slope (q,) times the level, or the total."""
        level, C = (self.total, self.total_covariance) if total else (self.level, self.covariance)
        return level @ slope, np.sqrt(np.maximum(np.einsum("i,tij,j->t", slope, C, slope), 0.0))

    def project_stretches(self, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of each stretch (E,), with the covariance (E, E) of its errors."""
        E, q = len(self.knots), len(self.parameters)
        blocks = self.stretch_covariance.reshape(E, q, E, q)
        return self.stretch.reshape(E, q) @ slope, np.einsum("i,eifj,j->ef", slope, blocks, slope)


def health_path(history: History, background: Background, events: np.ndarray, wrong: np.ndarray) -> HealthPath:
    """The health of a history whose offsets are marginalised, beside the background without events.

    events (T, p, c): columns of all events and their doubts, of standard normal amount; wrong (T, p, d): of those of
    instruments alone.
    """
    H = np.array([i for i, p in enumerate(history.parameters) if not p.belongs_to_instrument], int)
    names, unit = tuple(history.parameters[i].name for i in H), history.unit[H]
    knots = _knots(len(history), history.maintenance)
    both = np.outer(unit, unit)
    smooth = _smooth(history, background, events, H)
    r = len(background.d)
    moved_by = [0.0 * shift.course if shift.constant else shift.course for shift in history.shifts]
    level, covariance = smooth.evaluate(smooth.rows, KnownMoves.from_history(history, H, r, moved_by))
    every = [shift.course for shift in history.shifts]
    total, total_covariance = smooth.evaluate(smooth.rows, KnownMoves.from_history(history, H, r, every))
    moved = []
    for t in history.maintenance:
        across = KnownMoves.from_history(history, H, r, [np.diff(shift.course)[t - 1 : t] for shift in history.shifts])
        rows = smooth.rows[t : t + 1] - smooth.rows[t - 1 : t]
        (change,), (error,) = smooth.evaluate(rows, across if history.shifts else KnownMoves.none(1, len(H), r))
        moved.append(HealthStep(t, unit * total[t - 1], unit * change, both * error))
    stretch, errors = _stretches(history, background, wrong, (H, np.any(events[:, H] != 0, axis=(0, 2))), knots)
    scale = np.tile(unit, len(knots))
    return HealthPath(
        names,
        unit * level,
        both * covariance,
        unit * total,
        both * total_covariance,
        tuple(moved),
        knots,
        scale * stretch,
        scale[:, None] * errors * scale,
    )


def _knots(T: int, maintenance: Sequence[int]) -> np.ndarray:
    even = np.linspace(0, T, min(KNOTS, T), endpoint=False).round().astype(int)
    return np.unique(np.concatenate([even, np.array(maintenance, int)]))


@dataclass(frozen=True)
class _SmoothHealth:
    """rows (T, q, c): health by coefficients x of events, free change and maintenance, whose law is a mixture of normal
    ones: mean (c,) and covariance (c, c) of each, with weights `share`. Unit normals z that all flights share are

    z | x ~ N(A⁻¹(d − Nᵀx), A⁻¹),   N = hᵀB

    and move health by shifts that are known."""

    rows: np.ndarray
    found: Sequence[tuple[np.ndarray, np.ndarray]]
    share: np.ndarray
    inverse: np.ndarray
    d: np.ndarray
    N: np.ndarray

    def evaluate(self, rows: np.ndarray, shifts: KnownMoves) -> tuple[np.ndarray, np.ndarray]:
        """Mean (n, q) and covariance (n, q, q) of rows (n, q, c) x + shifts (n, q, r) z."""
        W = shifts.moves @ self.inverse
        rows = rows - W @ self.N.T
        means = [rows @ mean for mean, _ in self.found]
        mean = np.einsum("s,stq->tq", self.share, np.stack(means))
        covariance = W @ shifts.moves.transpose(0, 2, 1) + shifts.unknown
        for w, own, (_, C) in zip(self.share, means, self.found, strict=True):
            off = own - mean
            covariance += w * (rows @ C @ rows.transpose(0, 2, 1) + off[:, :, None] * off[:, None, :])
        return mean + W @ self.d, covariance


@dataclass(frozen=True)
class KnownMoves:
    """What the unit normals z move health by: moves (n, q, r), and covariance (n, q, q) of what flights do not know of
    it at all."""

    moves: np.ndarray
    unknown: np.ndarray

    @staticmethod
    def none(n: int, q: int, r: int) -> KnownMoves:
        return KnownMoves(np.zeros((n, q, r)), np.zeros((n, q, q)))

    @staticmethod
    def from_history(history: History, H: np.ndarray, r: int, courses: Sequence[np.ndarray]) -> KnownMoves:
        """Along courses (n,) of the shifts of a history, in their order; r unit normals are uncertain."""
        basis = nominal_basis(history)
        if not courses:
            return KnownMoves.none(len(history), len(H), r)
        n = len(courses[0])
        full = np.zeros((n, len(H), len(basis)))
        place = {int(i): k for k, i in enumerate(H)}
        for shift, course in zip(history.shifts, courses, strict=True):
            for j, (i, size) in enumerate(zip(shift.positions, shift.sizes, strict=True)):
                if int(i) in place:
                    full[:, place[int(i)], shift.first + j] += course * size
        moves = np.zeros((n, len(H), r))
        moves[:, :, : basis.shape[1]] = full @ basis
        return KnownMoves(moves, full @ full.transpose(0, 2, 1) - moves @ moves.transpose(0, 2, 1))


def _smooth(history: History, background: Background, events: np.ndarray, H: np.ndarray) -> _SmoothHealth:
    """Health by events, a free change and what maintenance restored, in prior standard deviations."""
    T, p = len(history), history.width
    free = _each_parameter(wander_modes(T), H, p)
    known = [int(np.argmax(shift.course > 0)) for shift in history.shifts]
    restored = np.array([t for t in history.maintenance if t not in known], int)
    at = (np.arange(T)[:, None] >= restored[None, :]).astype(float)
    h = np.concatenate([events, free, RESTORED * _each_parameter(at, H, p)], axis=2)
    b, M = background.joint(h)
    log, found = [], []
    for size, weight in zip(FREE_SIZES, FREE_WEIGHTS, strict=True):
        scale = np.ones(len(b))
        scale[events.shape[2] : events.shape[2] + free.shape[2]] = size
        posterior = np.linalg.inv(scale[:, None] * M * scale + np.eye(len(b)))
        mean = posterior @ (scale * b)
        log.append(np.log(weight) + 0.5 * float(mean @ (scale * b)) + 0.5 * float(np.linalg.slogdet(posterior)[1]))
        found.append((scale * mean, scale[:, None] * posterior * scale))
    share = np.exp(np.array(log) - np.logaddexp.reduce(log))
    return _SmoothHealth(h[:, H], found, share, np.linalg.inv(background.A), background.d, inner(h, background.B))


def _stretches(
    history: History,
    background: Background,
    wrong: np.ndarray,
    health: tuple[np.ndarray, np.ndarray],
    knots: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Health (E q,) of each stretch by itself, what instruments are wrong by marginalised, and its sampling errors;
    health (q,), (q,): positions of its parameters, and which of them changed by the events."""
    T, p = len(history), history.width
    H, changed = health
    number = np.searchsorted(knots, np.arange(T), side="right") - 1
    own = (number[:, None] == np.arange(len(knots))).astype(float)
    h = np.concatenate([_each_parameter(own, H, p), wrong], axis=2)
    b, M = background.joint(h)
    E = len(knots) * len(H)
    precision = np.tile(np.where(changed, OPEN, CLOSED) ** -2.0, len(knots))
    inverse = np.linalg.inv(M + np.diag(np.concatenate([precision, np.ones(len(b) - E)])))
    return (inverse @ b)[:E], (inverse @ M @ inverse)[:E, :E]


def _each_parameter(courses: np.ndarray, H: np.ndarray, p: int) -> np.ndarray:
    """Columns (T, p, k q) of courses (T, k), each of every parameter at positions H (q,)."""
    T, k = courses.shape
    h = np.zeros((T, p, k, len(H)))
    for c, i in enumerate(H):
        h[:, i, :, c] = courses
    return h.reshape(T, p, k * len(H))
