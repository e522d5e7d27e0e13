"""Is there a mismatch at all, beyond noise and what identification absorbs? Three tests that fail in different ways.

- *omnibus*: the fit's χ² of readings and priors against the number of readings n, where the noise is known and not
  estimated from these readings. It sees everything, if it is large: a misfit of λ stands out only when λ ≫ √(2n).
- *order*: residuals of one sensor, sorted along a driver, change smoothly where something that depends on the driver
  is missing. Von Neumann's ratio η = Σ(e_{i+1} − e_i)²/Σ(e_i − ē)² has mean 2n/(n−1) and variance
  4n²(n−2)/((n+1)(n−1)³) when they do not; no knowledge of the noise is needed, but that it is white.
- *directed*: the largest score of the free-form map, which sees a misfit of λ ≈ 20.

Half of the false-alarm probability is spent on the directed test, which also says where, a quarter on the search for
an amplitude without a recorded driver (`mismatch.hidden`); the first two share the rest.

Source: J. von Neumann, "Distribution of the Ratio of the Mean Square Successive Difference to the Variance",
Ann. Math. Statist. 12 (1941) 367–395.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from enginediag_cli.engine.term import DriverValues
from enginediag_cli.mismatch.fit.families import correlations
from enginediag_cli.mismatch.fit.freeform import Cell
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.scores import critical_surprise
from enginediag_cli.progress import stage

DIRECTED_SHARE, HIDDEN_SHARE, REST = 0.5, 0.25, 0.25
"""Of the false-alarm probability."""

LEAST_READINGS = 20
"""Fewer readings tell nothing of a correlation in time."""
CALIBRATION_LEVEL = 0.05
"""Level at which the number of independent looks is read off the drawn null distribution."""


@dataclass(frozen=True)
class Test:
    """`p` is adjusted for the looks of this test; `about` says what stood out, `where` and `along` tell it in words."""

    name: str
    statistic: float
    p: float
    share: float  # of the false-alarm probability
    about: str = ""
    where: str = ""
    along: str = ""

    def rejects(self, false_alarm: float) -> bool:
        return self.p <= self.share * false_alarm


@dataclass(frozen=True)
class Presence:
    """The three tests (omnibus None where the noise is not known). `looks`: how many independent looks the map is
    worth, so that a cell's adjusted significance is 1 − exp(−looks · p)."""

    omnibus: Test | None
    order: Test | None
    directed: Test
    looks: float
    false_alarm: float

    @property
    def tests(self) -> tuple[Test, ...]:
        return tuple(t for t in (self.directed, self.omnibus, self.order) if t is not None)

    @property
    def found(self) -> bool:
        return any(t.rejects(self.false_alarm) for t in self.tests)

    @property
    def located(self) -> bool:
        """Whether the map shows where."""
        return self.directed.rejects(self.false_alarm)

    def adjusted(self, surprise: float) -> float:
        """Adjusted significance of one cell of the map."""
        return float(-np.expm1(-self.looks * np.exp(-surprise)))


@stage("testing whether model and recordings differ")
def presence(
    projection: Projection, cells: Sequence[Cell], along: Sequence[DriverValues], rng: np.random.Generator
) -> Presence:
    """Judge a fit: `cells` are its map, drivers' values are of all records of the evidence."""
    evidence = projection.found.evidence
    ranked = [c for c in cells if not c.score.absorbed]
    (gate,) = critical_surprise(*correlations(ranked), (CALIBRATION_LEVEL,), rng)
    looks = float(-np.log1p(-CALIBRATION_LEVEL) * np.exp(gate)) if np.isfinite(gate) else 1.0
    best = max(cells, key=lambda c: c.surprise, default=None)
    surprise = best.surprise if best else 0.0
    about = f"{best.location.name} along {best.driver.name}" if best else ""
    words = (best.location.words, best.driver.short) if best else ("", "")
    directed = Test("directed", surprise, float(-np.expm1(-looks * np.exp(-surprise))), DIRECTED_SHARE, about, *words)
    omnibus = None
    if evidence.settings.noise == "specified":
        p = float(stats.chi2.sf(projection.objective, projection.dof))
        omnibus = Test("omnibus", projection.objective, p, REST / 2, f"expected {projection.dof}")
    order = order_test(projection, along, REST / 2 if omnibus else REST, rng)
    return Presence(omnibus, order, directed, looks, evidence.settings.false_alarm)


def order_test(
    projection: Projection, along: Sequence[DriverValues], share: float, rng: np.random.Generator
) -> Test | None:
    """Von Neumann's ratio of each sensor's residuals along each driver; the smallest p, times the looks. None where
    no sensor has readings enough. `statistic` is the ratio, 2 for residuals without order."""
    found, frame = projection.found, projection.frame
    e = projection.left
    quantities = {c: s.quantity for c, s in found.evidence.engine.sensors.items()}
    looks, best = 0, (1.0, 2.0, "", "", "")
    for s, column in enumerate(found.problem.sensors):
        rows = np.flatnonzero(frame.sensor == s)
        for d in along:
            x = d.values[found.number][frame.record[rows]]
            good = np.isfinite(x)
            if good.sum() < LEAST_READINGS:
                continue
            looks += 1
            # equal values of the driver come in no order of their own
            order = np.lexsort((rng.permutation(int(good.sum())), x[good]))
            ratio, p = von_neumann(e[rows[good]][order])
            best = min(best, (p, ratio, f"{column} along {d.name}", quantities[column], d.short))
    if not looks:
        return None
    return Test("order", best[1], min(1.0, looks * best[0]), share, *best[2:])


def von_neumann(e: np.ndarray) -> tuple[float, float]:
    """Ratio of the mean square successive difference to the variance of e (n,), and the probability of one as small
    as this without order (normal approximation)."""
    n = len(e)
    centred = e - e.mean()
    ratio = float((np.diff(e) ** 2).sum() / max(float(centred @ centred), 1e-300))
    mean, variance = 2.0 * n / (n - 1), 4.0 * n**2 * (n - 2) / ((n + 1) * (n - 1) ** 3)
    return ratio, float(stats.norm.cdf((ratio - mean) / np.sqrt(variance)))
