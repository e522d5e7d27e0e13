"""Which further recording would separate two explanations that these flights cannot tell apart.

With I the information of the flights (priors included) about nuisance z, the coefficients t that only the one
explanation has and r that only the other has, the misfit that is left when t is true, of size Δ, and r is fitted is

    λ_sep = Δᵀ (I_tt − I_ty I_yy⁻¹ I_yt) Δ      y = (z, r)

n further records of information G each (offsets of a new recording, by their prior, eliminated) make it λ_sep(I + G).
The gain is the smaller of that for t and that for r being true. Candidates: operating conditions over the engine's
envelope; records with a switched effect off; readings that the model can predict and nobody has recorded.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.isolation.conditions_grid import conditions_grid
from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.fit.evidence import Evidence, Flight
from enginediag_cli.mismatch.fit.extended import ExtendedModel
from enginediag_cli.mismatch.fit.identified import (
    Hypothesis,
    Identified,
    Nuisance,
    identify_with,
    inputs_of,
    nuisance,
)
from enginediag_cli.mismatch.fit.options import together
from enginediag_cli.mismatch.fit.projection import Projection, derivatives, nuisance_columns
from enginediag_cli.progress import stage

RECORDS = 100
"""Further records for which a gain is told."""

SEPARATED = 11.0
"""λ_sep at which the right one of two explanations comes first 19 times out of 20."""

MOST_RECORDS = 10_000
"""More than a recording to come would have: told as “never”. (A flight of three hours at one a second.)"""
SAMPLE = 60  # recorded points that stand for "conditions like these"
NOISE = {"K": 0.002, "Pa": 0.004, "rpm": 0.001}
"""Assumed of a further sensor: standard deviation of a reading, relative to its mean."""

SCALE = 0.002
"""Assumed scale error of a further sensor, standard deviation."""

SAME, CONDITION, SWITCH, SENSOR, MANOEUVRE = "same", "condition", "switch", "sensor", "manoeuvre"


@dataclass(frozen=True)
class Suggestion:
    """One recording judged: λ_sep that RECORDS records add, and records that it takes to add SEPARATED (inf: more
    than MOST_RECORDS). `what`: effect to be switched off, or column of the sensor; `values`: operating condition. Of a
    manoeuvre, `what` in words: λ_sep that one adds, and how many it takes."""

    kind: str
    what: str
    values: Mapping[str, float]
    gain: float
    records: float


@dataclass(frozen=True)
class Advice:
    """Between two explanations: λ_sep of the flights as they are, and suggestions, most useful first."""

    rivals: tuple[str, str]
    separation: float
    suggestions: tuple[Suggestion, ...]

    @property
    def separates(self) -> bool:
        return any(s.records <= MOST_RECORDS for s in self.suggestions)


@dataclass
class _Rivals:
    """Names of z, t and r and what they are at the fit; columns in prior standard deviations."""

    found: Identified
    projection: Projection
    model: ExtendedModel
    names: list[str]
    scale: np.ndarray
    t: np.ndarray  # positions of t and of r among the names
    r: np.ndarray
    sizes: tuple[np.ndarray, np.ndarray]
    along: Nuisance
    information: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        found, p = self.found, self.projection
        J, offsets = nuisance_columns(found)
        k = len(self.names) - J.shape[2]
        self.free = np.concatenate([~found.fit.at_bound, np.ones(k, bool)])
        self.recorded = J
        if k:
            more = derivatives(found, self.names[J.shape[2] :], self.model) * self.scale[J.shape[2] :]
            self.recorded = np.concatenate([J, more], axis=2)
        X = np.concatenate([p.frame.rows(self.recorded[:, :, self.free]), p.frame.rows(offsets)], axis=1)
        I = X.T @ X + np.eye(X.shape[1])
        n = int(self.free.sum())
        # offsets of the recordings that are there belong to no further one
        self.information = I[:n, :n] - I[:n, n:] @ np.linalg.solve(I[n:, n:], I[n:, :n])
        at = np.cumsum(self.free) - 1
        self.t, self.r = at[self.t[self.free[self.t]]], at[self.r[self.free[self.r]]]

    def separation(self, G: np.ndarray) -> tuple[float, float]:
        """λ_sep of t against r, and of r against t."""
        I = self.information + G
        result = []
        for own, size in ((self.t, self.sizes[0]), (self.r, self.sizes[1])):
            if not len(own) or len(own) != len(size):
                result.append(np.inf)
                continue
            y = np.setdiff1d(np.arange(len(I)), own)
            part = I[np.ix_(own, own)] - I[np.ix_(own, y)] @ np.linalg.solve(I[np.ix_(y, y)], I[np.ix_(y, own)])
            result.append(float(size @ (part - np.eye(len(own))) @ size))
        return result[0], result[1]


@stage("looking for recordings that separate rivals")
def advise(base: Identified, first: Explanation, second: Explanation, most: int = 3) -> Advice | None:
    """What would separate two explanations fitted to the evidence of `base`: the best `most` of each kind; None when
    the fit with the first does not converge or the rivals do not differ."""
    evidence, grid = _with_conditions(base.evidence)
    along = nuisance(evidence)
    rivals = _rivals(evidence, base, along, first, second)
    if rivals is None:
        return None
    now = rivals.separation(np.zeros_like(rivals.information))
    offsets = _offset_rows(rivals)
    rows = np.unique(np.linspace(0, len(rivals.recorded) - 1, SAMPLE).astype(int))
    sigma = rivals.found.problem.sigma
    like_these = np.nan_to_num(rivals.recorded[rows] / sigma[:, None])[:, :, rivals.free]
    judged = [_judged(rivals, now, SAME, "", {}, like_these, offsets)]
    for names, e in _switched(rivals, first, second):
        off = like_these.copy()
        off[:, :, names] = 0.0
        judged.append(_judged(rivals, now, SWITCH, e, {}, off, offsets))
    conditions = []
    for values, X in _conditions(rivals, evidence, grid, sigma):
        conditions.append(_judged(rivals, now, CONDITION, "", values, X, offsets))
    sensors = [
        _judged(rivals, now, SENSOR, column, {}, X, o) for column, X, o in _sensors(rivals, rows, like_these, offsets)
    ]
    for found in (conditions, sensors):
        judged += sorted(found, key=lambda s: (s.records, -s.gain))[:most]
    return Advice((first.label, second.label), min(now), tuple(sorted(judged, key=lambda s: (s.records, -s.gain))))


def _rivals(
    evidence: Evidence, base: Identified, along: Nuisance, first: Explanation, second: Explanation
) -> _Rivals | None:
    records = sum(len(next(iter(f.columns.values()))) for f in evidence.flights)
    ours, theirs = (_extended(together(*e.options), base.evidence, records) for e in (first, second))
    found = identify_with(evidence, ours, along, base)
    more = [n for n in theirs.names if n not in ours.names]
    only = [n for n in ours.names if n not in theirs.names]
    if not found.converged or not (more or only):
        return None
    effects = {e.label: e for e in (*evidence.engine.effects, *ours.effects, *theirs.effects)}
    discrepancies = (*found.model.discrepancies, *(d for d in theirs.discrepancies if d.name in more))
    model = ExtendedModel(evidence.engine.with_effects(tuple(effects.values())), discrepancies)
    curves = {key: curve[found.number] for key, curve in theirs.curves.items()}
    found = replace(found, problem=replace(found.problem, inputs={**curves, **found.problem.inputs}))
    names = [*found.problem.names, *more]
    sigma = [model.parameters[n].prior_sigma for n in more]
    scale = np.concatenate([found.problem.prior_sigma, sigma])
    at = {n: j for j, n in enumerate(names)}
    values = {c.name: c.value for e in (first, second) for c in e.coefficients}
    sizes = [
        np.array([(values[n] - model.parameters[n].nominal) / scale[at[n]] for n in part]) for part in (only, more)
    ]
    t, r = (np.array([at[n] for n in part], int) for part in (only, more))
    everything = Nuisance(along.sigma, along.discrepancies, {**along.curves, **ours.curves, **theirs.curves})
    return _Rivals(found, Projection(found), model, names, scale, t, r, (sizes[0], sizes[1]), everything)


def _with_conditions(evidence: Evidence) -> tuple[Evidence, dict[str, np.ndarray]]:
    """The evidence with a flight through the conditions of the envelope that has no readings: its curves and those of
    the flights are then the same."""
    grid = conditions_grid(evidence.engine)
    if not grid:
        return evidence, {}
    sensors = {c: np.full(len(next(iter(grid.values()))), np.nan) for c in evidence.noise.sigma}
    flight = Flight("further conditions", evidence.engines[0], {**grid, **sensors})
    return replace(evidence, flights=(*evidence.flights, flight)), grid


def _extended(h: Hypothesis, evidence: Evidence, records: int) -> Hypothesis:
    """Curves over further records: as the first engine's flights ended."""
    mine = evidence.engines[0]
    last = np.cumsum([len(next(iter(f.columns.values()))) for f in evidence.flights]) - 1
    end = int(max(k for k, f in zip(last, evidence.flights, strict=True) if f.engine == mine))
    longer = {n: np.concatenate([c, np.full(records - len(c), c[end])]) for n, c in h.curves.items()}
    return replace(h, curves=longer)


def _judged(
    rivals: _Rivals,
    now: tuple[float, float],
    kind: str,
    what: str,
    values: Mapping[str, float],
    X: np.ndarray,
    offsets: np.ndarray,
) -> Suggestion:
    """X (k, m, z): rows of typical records; offsets (m, o): what a new recording's own offsets do to them."""
    k, m, q = X.shape
    both = np.concatenate([X, np.broadcast_to(offsets, (k, *offsets.shape))], axis=2).reshape(k * m, -1)
    G = both.T @ both / k

    def gain(n: float) -> float:
        inner = n * G[q:, q:] + np.eye(G.shape[1] - q)
        G_n = n * G[:q, :q] - n**2 * G[:q, q:] @ np.linalg.solve(inner, G[q:, :q])
        then = rivals.separation(G_n)
        return max(0.0, min(b - a for a, b in zip(now, then, strict=True) if np.isfinite(a)))

    return Suggestion(kind, what, values, gain(RECORDS), _records_for(gain))


def _records_for(gain: object) -> float:
    if gain(MOST_RECORDS) < SEPARATED:  # type: ignore[operator]
        return float("inf")
    low, high = 0, MOST_RECORDS
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if gain(middle) >= SEPARATED else (middle, high)  # type: ignore[operator]
    return float(high)


def _offset_rows(rivals: _Rivals) -> np.ndarray:
    """(m, o): what a recording's offsets, in prior standard deviations, do to the whitened readings of a record."""
    p = rivals.found.problem
    O = np.zeros((len(p.sensors), len(p.offsets)))
    mean = np.nanmean(np.abs(p.measured), axis=0)
    for j, o in enumerate(p.offsets):
        s = p.sensors.index(o.sensor)
        O[s, j] = o.prior_sigma * (1.0 if o.kind == "bias" else mean[s]) / p.sigma[s]
    return O


def _switched(rivals: _Rivals, first: Explanation, second: Explanation) -> list[tuple[list[int], str]]:
    """Columns of each effect of the rivals that can be switched off, and its label."""
    at = np.cumsum(rivals.free) - 1
    result = {}
    for option in (*first.options, *second.options):
        for e in option.hypothesis.effects:
            if e.term.SWITCHES:
                columns = [rivals.names.index(n) for n in e.amplitudes]
                result[e.label] = [int(at[j]) for j in columns if rivals.free[j]]
    return [(columns, label) for label, columns in result.items() if columns]


def _conditions(
    rivals: _Rivals, evidence: Evidence, grid: Mapping[str, np.ndarray], sigma: np.ndarray
) -> list[tuple[dict[str, float], np.ndarray]]:
    """Each condition of the grid that the engine can reach, with its whitened rows (1, m, z)."""
    if not grid:
        return []
    C = len(next(iter(grid.values())))
    inputs = {c: v[-C:] for c, v in inputs_of(evidence).items()}
    curves = {k: v[-C:] for k, v in rivals.along.curves.items()}
    p = rivals.model.predict(
        {**inputs, **curves}, rivals.found.theta, sensors=rivals.found.problem.sensors, wrt=tuple(rivals.names)
    )
    X = (p.jacobian * rivals.scale / sigma[:, None])[:, :, rivals.free]
    return [({c: float(v[k]) for c, v in grid.items()}, X[k : k + 1]) for k in np.flatnonzero(p.status == 0)]


def _sensors(
    rivals: _Rivals, rows: np.ndarray, present: np.ndarray, offsets: np.ndarray
) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Each station's temperature and pressure and each speed that is not recorded: column, rows with it (k, m+1, z),
    and offsets with its scale error."""
    problem, engine = rivals.found.problem, rivals.found.evidence.engine
    known = {*problem.sensors, *engine.inputs}
    columns = [c for c in engine.model_columns if c not in known and re.fullmatch(r"[TP]\d+_(K|Pa)|\w+_rpm", c)]
    if not columns:
        return []
    inputs = {c: v[rows] for c, v in problem.inputs.items()}
    p = rivals.model.predict(inputs, rivals.found.theta, sensors=tuple(columns), wrt=tuple(rivals.names))
    ok = np.asarray(p.ok)
    known_there = rivals.model.predict(inputs, rivals.found.theta, sensors=problem.sensors).y[ok]
    alike = [*known_there.T]
    result = []
    for j, column in enumerate(columns):
        mean = float(np.mean(np.abs(p.y[ok, j])))
        noise = NOISE[column.rpartition("_")[2]] * mean
        own = (p.jacobian[ok, j] * rivals.scale / noise)[:, rivals.free]
        if not np.isfinite(own).all() or not own.any():
            continue
        if any(np.ptp(p.y[ok, j] / y) < 1e-3 * abs(np.mean(p.y[ok, j] / y)) for y in alike):
            continue  # the same reading but for a constant factor, such as behind a duct
        alike.append(p.y[ok, j])
        X = np.concatenate([present[ok], own[:, None]], axis=1)
        wider = np.zeros((X.shape[1], offsets.shape[1] + 1))
        wider[:-1, :-1] = offsets
        wider[-1, -1] = SCALE * mean / noise
        result.append((column, X, wider))
    return result
