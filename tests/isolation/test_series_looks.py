"""Looks at a series with events taken out, and what suspects are worth by the scatter that each one's event leaves."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.detection.series import build_readings
from enginediag_cli.detection.wander import candidate_courses, pair_places
from enginediag_cli.isolation.events import EventModel, log_kind_prior, suspect_groups
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.isolation.timeline import SETTLED, SeriesSearch
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.statistics import LocalStatistics

SENSORS = tuple(f"sensor.{name}.bias" for name in ("T3", "P3", "T5", "N2"))
HEALTH = ("fan.efficiency", "hpc.efficiency", "hpt.efficiency")
MEANING = {
    **{
        n: Parameter(n, "health", 1.0, 0.5, 1.5, 0.02, component=n.split(".")[0], quantity="efficiency") for n in HEALTH
    },
    **{n: Parameter(n, "sensor", 0.0, -9, 9, 3.0, component=n[: n.rindex(".")], quantity="bias") for n in SENSORS},
}
HPC = np.array([4.0, -2.0, -3.0, 1.0])
ACROSS = np.array([0.4, 1.0, -0.3, -0.5])
FAN = np.array([1.0, 3.0, -2.0, 1.0])


def readings(seed, change, alike):
    """A series in which the HPC changes by so many prior sigmas (n,); the HPT acts alike but for `alike` across."""
    rng = np.random.default_rng(seed)
    sigma = np.array([p.prior_sigma for p in MEANING.values()])
    J = np.concatenate([np.stack([FAN, HPC, HPC + alike * ACROSS], axis=1), 3 * np.eye(4)], axis=1) / sigma
    n = len(change)
    e = np.asarray(change)[:, None] * HPC + rng.standard_normal((n, 4))
    F = J.T @ J
    fixed = {"theta0": np.zeros(7), "prior_sigma": sigma, "F": F, "V": F, "n": 1, "chi2": 4.0, "dof": 4.0}
    statistics = [LocalStatistics(parameters=tuple(MEANING), s=J.T @ row, **fixed) for row in e]
    return build_readings(statistics, list(MEANING.values()), np.arange(float(n)))


def worn(n, size):
    return -size * (np.arange(n) / (n - 1)) ** 4


def looks_at(series):
    suspects, among = suspect_groups(tuple(MEANING.values()), SetPrior()), candidate_courses(series.clock)
    at, doubt = pair_places(np.eye(7, dtype=bool)), np.zeros(len(suspects.groups))
    return SeriesSearch(series, suspects, among, log_kind_prior(suspects, among), SetPrior().slabs, doubt, at)


def test_the_same_suspect_and_course_with_another_size_is_another_look():
    looks = looks_at(readings(1, worn(40, 3.0), 1.0))
    group = looks.suspects.owner.index("hpc")
    course = int(np.argmin(np.sum((looks.courses.g + worn(40, 1.0)) ** 2, axis=1)))
    small, right = (
        looks.evaluate([EventModel(group, course, (-0.5,))]),
        looks.evaluate([EventModel(group, course, (-3.0,))]),
    )
    assert right.log > small.log + SETTLED
    assert looks.evaluate([EventModel(group, course, (-0.5,))]) is small


def test_no_event_found_is_likelier_by_the_scatter_that_it_leaves_with_another_size():
    series = readings(2, worn(40, 3.0), 0.3)
    looks = looks_at(series)
    best, _, settled = looks.find_events()
    assert settled and len(best.chosen) == 1
    for factor in (0.5, 0.8, 1.25, 2.0):
        event = best.chosen[0]
        other = EventModel(event.group, event.course, tuple(factor * s for s in event.size), event.shares)
        assert looks.evaluate([other]).log < best.log + SETTLED


def test_a_suspect_that_acts_as_the_one_found_is_as_probable_as_it_by_its_own_scatter():
    looks = looks_at(readings(3, worn(40, 3.0), 0.0))
    best, _, _ = looks.find_events()
    (found,) = looks.event_evidence(best)
    (other,) = {"hpc", "hpt"} - {looks.suspects.owner[best.chosen[0].group]}
    assert found.alternatives[other] == pytest.approx(0.0, abs=0.5)
    assert found.log_odds > 5
