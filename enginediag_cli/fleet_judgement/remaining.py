"""How many flights remain to the limit of each engine, with what the rest of the fleet says of how engines wear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.config.hints import near
from enginediag_cli.detection.forecast import Course, Fitted, Population, fitted, forecast, learnt
from enginediag_cli.errors import DataError
from enginediag_cli.fleet_judgement.finding import EngineFinding, Estimate, FleetSettings
from enginediag_cli.intervals import NORMAL_95

EPOCHS = 60
"""Epochs of a course that a law of growth is fitted to: none is finer."""
LEARNT_FROM = 300
"""Engines from which it is learnt how the fleet wears, evenly chosen where there are more: it is known well by then."""
LIVES = 3
"""Whole lives from which a limit is learnt at least: with two the spread between engines is not known."""
NEVER_K = 1e9
"""A limit that is not reached, where only the consumption so far is asked for."""
RECOVERED_K = 10.0
"""Standard deviation of what maintenance may bring of a margin, in K: washes bring up to as much."""


def course_of(finding: EngineFinding) -> Course | None:
    """Consumption over the flights of a finding; None where it is not known."""
    rows = [r for r in finding.by_flight if np.isfinite(r.consumed_K)]
    if len(rows) < 3:
        return None
    # nothing has begun in the baseline, which of an engine that was renewed begins there
    begin = rows[0].number - 1 + finding.baseline
    t = np.array([r.number - begin for r in rows], float)
    y, error = np.array([r.consumed_K for r in rows]), np.array([r.consumed_error_K for r in rows])
    events = [e.number - begin for e in finding.events if e.gains and rows[0].number < e.number <= rows[-1].number]
    steps = (t[:, None] >= np.array(events, float)).astype(float).reshape(len(t), len(events))
    edges = np.unique(
        np.concatenate(
            [np.linspace(0, len(t), EPOCHS, endpoint=False).astype(int), *[np.flatnonzero(t >= e)[:1] for e in events]]
        ).astype(int)
    )
    count = np.diff(np.append(edges, len(t)))

    def mean(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values, edges, axis=0) / count.reshape(-1, *[1] * (values.ndim - 1))

    noise = np.diag(mean(error**2) / count)
    offset = float(np.sqrt(np.mean(error**2) / max(finding.baseline, 1)))
    return Course(mean(t), mean(y), noise, float(t[-1]), mean(steps), offset, RECOVERED_K)


def limit_of(finding: EngineFinding, settings: FleetSettings) -> tuple[float, float] | None:
    """Consumption, in K, at which the limit is reached, with its standard deviation; None where there is no limit."""
    margin = finding.margin
    if not margin.column:
        return None
    if np.isfinite(margin.limit_K):
        return margin.now_K.value + margin.consumed_K.value, 0.0
    return settings.consumed_limit_K


def learnt_limit(failed: Sequence[EngineFinding]) -> tuple[float, float]:
    """Consumption, in K, at which engines were taken off, and its standard deviation between them, from the findings
    of their whole lives: what `FleetSettings.consumed_limit_K` asks for. ValueError for fewer than three."""
    courses = [c for f in failed if (c := course_of(f)) is not None]
    if len(courses) < LIVES:
        raise ValueError(f"a limit is learnt from {LIVES} lives at least, and {len(courses)} can be followed")
    reference = float(np.nanmedian([f.severity.value for f in failed]))
    fits = [fitted(c, reference) for c in courses]
    return limit_from(*ends_of(fits, learnt(fits)))


def with_taken_off(
    settings: FleetSettings, findings: Sequence[EngineFinding], named: Sequence[str], where: str
) -> FleetSettings:
    """The settings with the limit that engines had reached that were taken off, where some are `named`; where: what
    names them. Raises DataError for one that is not among the findings, and where they do not tell a limit."""
    if not named:
        return settings
    known = {finding.serial: finding for finding in findings}
    for serial in named:
        if serial not in known:
            hint = near(serial, known) if any(known) else "the recordings name no engines, as a column `engine` does"
            raise DataError(f"{where} names engine {serial}, which is not judged; {hint}")
    try:
        limit = learnt_limit([known[serial] for serial in dict.fromkeys(named)])
    except ValueError as error:
        raise DataError(f"{where}: {error}") from None
    return replace(settings, consumed_limit_K=limit)


def ends_of(fits: Sequence[Fitted], population: Population) -> tuple[np.ndarray, np.ndarray]:
    """Consumption (n,) at the end of each course, with its standard error (n,)."""
    ends = [forecast(fit, population, NEVER_K) for fit in fits]
    return np.array([e.level for e in ends]), np.array([e.level_error for e in ends])


def limit_from(level: np.ndarray, error: np.ndarray) -> tuple[float, float]:
    """Mean of the ends of lives and their standard deviation, what they are known to taken out."""
    spread = float(np.sqrt(max(level.var(ddof=1) - float(np.mean(error**2)), 0.0)))
    return float(level.mean()), spread


def with_forecasts(findings: Sequence[EngineFinding], settings: FleetSettings) -> list[EngineFinding]:
    """The findings with the flights that remain to the limit, or the reason why that is not known."""
    limits = [limit_of(f, settings) for f in findings]
    stated = [x[0] for x in limits if x is not None and x[0] > 0]
    if not stated:
        return [_without(f, "no limit is stated") for f in findings]
    reference = float(np.median(stated))
    at = [k for k, x in enumerate(limits) if x is not None]
    some = np.unique(np.linspace(0, len(at) - 1, LEARNT_FROM).round().astype(int))
    courses = [course_of(findings[at[k]]) for k in some.tolist()]
    population = learnt([fitted(c, reference) for c in courses if c is not None])
    return [_with_one(f, x, reference, population) for f, x in zip(findings, limits, strict=True)]


def _with_one(
    finding: EngineFinding, limit: tuple[float, float] | None, reference: float, population: Population
) -> EngineFinding:
    if limit is None:
        return _without(finding, "no limit is stated")
    course = course_of(finding)
    if course is None:
        return _without(finding, "too few flights tell of the margin")
    found = forecast(fitted(course, reference), population, *limit)
    half = NORMAL_95 * found.rate_error
    margin = replace(
        finding.margin,
        remaining_flights=Estimate(found.quantile(0.5), found.quantile(0.05), found.quantile(0.95)),
        rate_K_per_flight=Estimate(found.rate, found.rate - half, found.rate + half),
    )
    return replace(finding, margin=margin)


def _without(finding: EngineFinding, reason: str) -> EngineFinding:
    return replace(finding, margin=replace(finding.margin, reason=finding.margin.reason or reason))
