"""Records where identification has not been: judged with wider limits, and beyond a reach not at all."""

from __future__ import annotations

from functools import cache

import numpy as np

from enginediag_cli.detection.verdict import FAULT, judge
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.report.tables.recordings import outside_envelope_lines
from enginediag_cli.residuals.monitor import monitor_from_nominal
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.reduced import compact_monitor, reduce_monitor
from enginediag_cli.residuals.windows import Extrapolation, WindowPlan, select_inputs
from enginediag_cli.shipped import shipped


@cache
def engine():
    return load_engine(str(shipped("turbofan.yaml")))


def flown(seed, n, altitude, power):
    """Readings (n,) of the engine itself at operating points drawn from ranges."""
    e, rng = engine(), np.random.default_rng(seed)
    h = rng.uniform(*altitude, n)
    u = {"altitude_m": h, "mach": 0.3 + 0.5 * h / 11_000, "dT_isa_K": rng.normal(0, 8, n)}
    u[e.power_setting] = e.power_from_fraction(rng.uniform(*power, n), u)
    p = e.predict(u, sensors=tuple(e.sensors))
    assert p.ok.all()
    sigma = np.array([s.noise_sigma for s in e.sensors.values()])
    y = p.y + sigma * rng.standard_normal(p.y.shape)
    return {**u, **dict(zip(p.columns, y.T, strict=True))}


@cache
def nominal():
    """Identified low and at middle power alone."""
    flights = [TrainingRecording(f"flight {k}", flown(k, 60, (0, 5_000), (0.5, 0.8))) for k in range(2)]
    result = identify(engine(), flights, cross_validation=False)
    assert result.converged
    return result.nominal("", "", {})


@cache
def monitor():
    return monitor_from_nominal(engine(), nominal())


def recording(columns):
    n = len(columns["mach"])
    return Recording(columns, line=np.arange(2, n + 2), source="later.csv")


def high(seed=9, n=40):
    """Higher than training, at more power."""
    return flown(seed, n, (6_000, 7_000), (0.85, 0.95))


def test_every_form_of_a_monitor_is_as_wide_beyond_training_as_the_whole_one():
    """Directions of what is uncertain that have no effect where training was are not lost."""
    u = {c: v for c, v in high().items() if c in engine().inputs}
    for points in (u, {c: v for c, v in flown(8, 40, (0, 5_000), (0.5, 0.8)).items() if c in u}):
        variances = []
        for form in (monitor(), reduce_monitor(monitor()), compact_monitor(monitor())):
            J = form.predict(points, form.theta0)[1]
            variances.append(np.einsum("nmp,pq,nmq->nm", J, form.uncertainty, J))
        scale = (
            variances[0] + 0.05 * monitor().noise.sigma ** 2
        )  # what is far below the noise, or negligible in training, may be left out
        for other in variances[1:]:
            np.testing.assert_allclose(other / scale, variances[0] / scale, atol=0.15)


def test_every_form_of_a_monitor_is_as_wide_where_worn_machines_run_as_the_whole_one():
    """Off the line of training, not at its ends: map coordinates of the record moved by up to what two or three per
    cent of wear move them, to either side."""
    u = {c: v for c, v in flown(8, 40, (0, 5_000), (0.5, 0.8)).items() if c in engine().inputs}
    frozen = monitor().predict(u, monitor().theta0)[3].frozen
    rng = np.random.default_rng(3)
    moved = {c: v + 0.04 * rng.uniform(-1, 1, len(v)) if " ln " in c else v for c, v in frozen.items()}
    J = monitor().predict({**u, **moved}, monitor().theta0)[1]
    whole = np.einsum("nmp,pq,nmq->nm", J, monitor().uncertainty, J)
    # records whose machines have left the line: readings are less sure there by a fifth of their noise and more
    J0 = monitor().predict({**u, **frozen}, monitor().theta0)[1]
    assert np.any(whole > 2.0 * np.einsum("nmp,pq,nmq->nm", J0, monitor().uncertainty, J0) + 0.04)
    for form in (reduce_monitor(monitor()), compact_monitor(monitor())):
        J = form.predict({**u, **moved}, form.theta0)[1]
        np.testing.assert_allclose(
            np.einsum("nmp,pq,nmq->nm", J, form.uncertainty, J) / monitor().noise.sigma ** 2,
            whole / monitor().noise.sigma ** 2,
            rtol=0.02,
            atol=2e-3,
        )


def test_healthy_records_beyond_training_are_judged_and_are_no_alarm():
    taken = select_inputs(monitor(), recording(high()))
    assert taken.uncovered.all() and taken.judged.all()
    (window,) = window_statistics(reduce_monitor(monitor()), [recording(high())], WindowPlan())
    assert judge(window).verdict != FAULT
    assert sum(window.extrapolation.values()) == 40 and window.outside == 0


def test_an_answer_beyond_training_is_wider_than_within():
    errors = []
    for columns in (flown(8, 40, (0, 5_000), (0.5, 0.8)), high()):
        (window,) = window_statistics(reduce_monitor(monitor()), [recording(columns)], WindowPlan())
        s = window.statistics
        a, own = monitor().monitored.index("hpc.efficiency"), len(monitor().monitored)
        information = s.F + np.diag(np.arange(len(s.F)) >= own)  # unit normals are known to ±1
        errors.append(np.sqrt(np.linalg.pinv(information)[a, a]))
    assert errors[1] > 1.5 * errors[0]


def test_the_input_that_is_outside_is_named_with_how_many_records():
    columns = high(n=10)
    far = {c: v.copy() for c, v in columns.items()}
    far["altitude_m"] += 60_000.0
    both = {c: np.concatenate([columns[c], far[c]]) for c in columns}
    taken = select_inputs(monitor(), recording(both))
    assert taken.outside.tolist() == [False] * 10 + [True] * 10
    told = taken.count_extrapolation(slice(None))
    assert told[Extrapolation("altitude_m", False)] == 10
    assert sum(n for where, n in told.items() if where.judged) == 10
    lines = list(outside_envelope_lines(told))
    assert lines[0].startswith("10 records outside the operating points identified, judged")
    assert lines[1].endswith("too far to be judged: altitude_m in 10")


def test_where_nothing_widens_what_training_did_not_cover_is_not_judged():
    assert select_inputs(monitor(), recording(high()), widening=False).outside.all()
