"""Gross errors against answers that are known because they were put in: linear stretches with readings made wrong."""

from dataclasses import replace

import numpy as np
import pytest
from toy_engine import SENSORS, SIGMA, toy_monitor, toy_recording

from enginediag_cli.identification.gross_errors import (
    AROUND,
    BLOCK,
    HALO,
    RUN,
    ResidualStretch,
    find_brief_departures,
    find_gross_errors,
    running_median,
)
from enginediag_cli.residuals.gross_gate import GrossErrorGate, LiveGate, LiveRecords

N, M, P, Q = 130, 7, 5, 3


def ar1(rng, rho, n=N, m=M):
    e = rng.standard_normal((n, m))
    for k in range(1, n):
        e[k] = rho * e[k - 1] + np.sqrt(1 - rho**2) * e[k]
    return e


def stretch(rng, *, rho=0.0, theta=None, add=0.0, step_s=60.0):
    """Records whose sensitivities vary with power; theta (p,) in prior standard deviations, in all records."""
    power = np.repeat([0.2, 0.9, 0.7, 0.75, 0.3], N // 5)[:, None, None]
    G = 8 * rng.standard_normal((1, M, P)) * (1 + 0.3 * power)
    z = ar1(rng, rho) + add + (0 if theta is None else G @ np.asarray(theta))
    effects = 6 * rng.standard_normal((M, Q))
    time = np.arange(N) * step_s
    level = 300 * (1 + power[:, :, 0]) * np.ones(M)
    found = ResidualStretch(
        z, G, level, np.ones(N), time, np.eye(P), np.full(M, rho), lambda rows: np.tile(effects, (len(rows), 1, 1))
    )
    return found, effects


def test_running_median_is_numpys():
    x = np.random.default_rng(0).standard_normal(60)
    first = np.clip(np.arange(60) - AROUND // 2, 0, 60 - AROUND)
    expected = [np.median(x[i : i + AROUND]) for i in first]
    assert np.array_equal(running_median(x), expected)


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_clean_noise_loses_next_to_nothing(rho):
    rng = np.random.default_rng(1)
    lost = sum(find_gross_errors(stretch(rng, rho=rho)[0]).readings.sum() for _ in range(30))
    assert lost <= 3  # of 27,000 readings, 0.2 by the law of the normal


@pytest.mark.parametrize("sensors", [[2], [0, 2, 3, 5, 6]])
def test_of_a_change_that_lasts_no_record_is_lost_at_its_end(sensors):
    """A change of seven records and one of nine: from the 17th record on most around it are normal, so that three
    records of the second are seen to depart."""
    found, _ = stretch(np.random.default_rng(7))
    z = found.z.copy()
    for place in (slice(0, 7), slice(10, 19)):
        z[place] += 9.0 * np.isin(np.arange(M), sensors)
    gross = find_gross_errors(replace(found, z=z))
    assert not gross.records[10:19].any() and not gross.readings[10:19].any()


@pytest.mark.parametrize("rho", [0.0, 0.8])
@pytest.mark.parametrize("theta", [None, [3.0, 0, 0, -2.0, 0]])
def test_spikes_are_found_and_nothing_else(rho, theta):
    rng = np.random.default_rng(2)
    clean, _ = stretch(rng, rho=rho, theta=theta)
    wrong = rng.random((N, M)) < 0.01
    clean.z[wrong] += rng.choice([-1, 1], wrong.sum()) * rng.uniform(10, 30, wrong.sum())
    found = find_gross_errors(clean)
    assert np.array_equal(found.readings, wrong)
    assert not found.records.any()


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_a_burst_of_five_goes_and_a_step_of_ten_stays(rho):
    rng = np.random.default_rng(3)
    burst, _ = stretch(rng, rho=rho)
    burst.z[40:45, 2] += 20
    found = find_gross_errors(burst)
    assert found.readings[40:45, 2].all()
    assert found.readings.sum() == 5
    step, _ = stretch(rng, rho=rho)
    step.z[60:70, 2] += 20
    step.z[100:, 4] -= 20
    found = find_gross_errors(step)
    # of noise that remembers, a reading beside a step may be lost: its neighbour foretells another
    assert found.readings.sum() <= (2 if rho else 0)


def test_a_run_is_bounded_in_time_too():
    rng = np.random.default_rng(4)
    hourly, _ = stretch(rng, step_s=3600.0)
    hourly.z[40:45, 2] += 20
    hourly.z[80, 1] += 20
    found = find_gross_errors(hourly)
    assert found.readings.sum() == 1
    assert found.readings[80, 1]
    assert RUN * 60.0 < 600.0


def test_a_wrong_input_spoils_the_record_and_is_blamed():
    rng = np.random.default_rng(5)
    odd, effects = stretch(rng)
    odd.z[50] += 4 * effects[:, 1]
    found = find_gross_errors(odd)
    assert found.records.sum() == 1
    assert found.blamed[50] == 1
    assert not found.readings.any()


def test_where_few_records_were_what_is_uncertain_there_hides_no_wrong_input_and_costs_no_record():
    """One record where the model is known to 6 standard deviations of noise only, each sensor by itself: what lies
    within that is none of an input's doing, four times that is, though the uncertainty alone could make up for it."""
    kept = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        odd, effects = stretch(rng)
        alone = np.zeros((N, M, M))
        alone[50] = 6.0 * np.eye(M)
        odd = replace(odd, G=np.concatenate([odd.G, alone], axis=2), precision=np.eye(P + M))
        fair, wrong = odd.z.copy(), odd.z.copy()
        fair[50] += 6.0 * rng.standard_normal(M)
        wrong[50] += 24.0 * np.sign(effects[:, 1])
        found = find_gross_errors(replace(odd, z=wrong))
        assert found.records[50] or found.readings[50].all()
        found = find_gross_errors(replace(odd, z=fair))
        kept += not found.records[50] and not found.readings[50].any()
    assert kept >= 9  # one in a thousand is lost


def test_a_dead_sensor_is_no_reading_and_all_dead_is_another_matter():
    rng = np.random.default_rng(6)
    dead, _ = stretch(rng)
    dead.z[:, 3] = -dead.level[:, 3]
    found = find_gross_errors(dead)
    assert found.dead.tolist() == [j == 3 for j in range(M)]
    assert found.readings[:, 3].all()
    assert found.readings.sum() == N
    dead.z[:] = -dead.level
    assert not find_gross_errors(dead).dead.any()


def test_missing_readings_and_permuted_sensors_change_nothing():
    rng = np.random.default_rng(7)
    one, _ = stretch(rng)
    one.z[rng.random((N, M)) < 0.1] = np.nan
    one.z[[10, 90], [1, 5]] = 15.0
    order = rng.permutation(M)
    other = ResidualStretch(
        one.z[:, order], one.G[:, order], one.level[:, order], one.lags, one.time, one.precision, one.rho,
        lambda rows: one.input_effects(rows)[:, order],
    )  # fmt: skip
    assert np.array_equal(find_gross_errors(one).readings[:, order], find_gross_errors(other).readings)
    assert find_gross_errors(one).readings.sum() == 2


def spoilt_recording(rng, n=BLOCK + 3 * HALO, flights=1):
    clean = toy_recording(rng, n, flights=flights)
    rows = rng.choice(n * flights, 12, replace=False)
    columns = {c: clean[c].copy() for c in SENSORS}
    for i, k in enumerate(rows):
        columns[SENSORS[i % 5]][k] += 20 * SIGMA[i % 5]
    return clean, clean.with_columns(columns), rows


def test_the_gate_gives_the_same_whatever_the_chunks():
    rng = np.random.default_rng(8)
    _, spoilt, rows = spoilt_recording(rng)
    results = []
    for size in (len(spoilt), 700):
        gate = GrossErrorGate(toy_monitor())
        chunks = [spoilt.select(slice(i, i + size)) for i in range(0, len(spoilt), size)]
        parts = list(gate.clean(iter(chunks)))
        results.append(np.concatenate([np.column_stack([p[c] for c in SENSORS]) for p in parts]))
    assert np.array_equal(*results, equal_nan=True)
    assert np.array_equal(np.flatnonzero(np.isnan(results[0]).any(axis=1)), np.sort(rows))


def test_short_flights_are_judged_by_their_neighbours():
    rng = np.random.default_rng(9)
    _, spoilt, rows = spoilt_recording(rng, n=1, flights=60)
    parts = list(GrossErrorGate(toy_monitor()).clean(iter([spoilt])))
    found = np.isnan(np.column_stack([parts[0][c] for c in SENSORS])).any(axis=1)
    assert np.array_equal(np.flatnonzero(found), np.sort(rows))


def followed(e, block):
    """What a live gate decides of residuals e (n, m), fed in blocks: sizes of the blocks as they are decided for good,
    and all records as they look at the end."""
    monitor = toy_monitor()
    inputs = {c: np.full(len(e), x) for c, x in zip(monitor.engine.inputs, (5e3, 0.5, 0.8), strict=True)}
    y, J, _, _ = monitor.predict(inputs, monitor.theta0)
    k = np.arange(len(e))
    whole = LiveRecords(inputs, y + e * SIGMA, e * SIGMA, J, y, np.where(k == 0, np.inf, 1.0), 60.0 * k, k + 2)
    gate, decided, sizes = LiveGate(monitor, monitor.engine.inputs), [], []
    for i in range(0, len(e), block):
        found = gate.add(whole.select(slice(i, i + block)))
        decided += found.closed
        sizes.append(sum(len(d) for d in found.closed))
        assert sum(sizes) + sum(len(d) for d in found.open) == min(i + block, len(e))  # nothing lost, nothing twice
        assert [c.judged for c in found.rejected] == [len(d) for d in (*found.closed, *found.open)]
    return sizes, np.concatenate([d.e for d in (*decided, *found.open)]) / SIGMA


@pytest.mark.parametrize("block", [1, 5, 20])
def test_a_live_gate_drops_spikes_and_keeps_every_record_of_a_step(block):
    rng = np.random.default_rng(10)
    e = rng.standard_normal((120, 5))
    e[[30, 57, 59, 80], [0, 1, 2, 3]] += 20
    _, decided = followed(e, block)
    assert np.array_equal(np.argwhere(np.isnan(decided)), [[30, 0], [57, 1], [59, 2], [80, 3]])
    step = rng.standard_normal((120, 5))
    step[58:, 1] += 20
    sizes, decided = followed(step, block)
    assert len(decided) == len(step)
    assert np.allclose(decided, step)
    assert 120 - sum(sizes) < AROUND // 2 + block


@pytest.mark.parametrize("block", [5, 20, 60])
def test_two_bursts_of_a_sensor_one_after_the_other_go(block):
    rng = np.random.default_rng(11)
    e = rng.standard_normal((60, 5))
    e[[*range(2, 7), *range(10, 15)], 4] -= 27
    _, decided = followed(e, block)
    assert np.flatnonzero(np.isnan(decided).any(axis=1)).tolist() == [2, 3, 4, 5, 6, 10, 11, 12, 13, 14]


def test_what_is_brief_may_be_a_gross_error_and_what_lasts_is_not():
    t = np.random.default_rng(12).standard_normal((40, 3))
    t[4:9, 0] += 20
    t[30:, 1] += 20
    t[35:, 2] += 20
    brief = find_brief_departures(t, 60.0 * np.arange(40), np.arange(40.0))
    assert [np.flatnonzero(b).tolist() for b in brief.T] == [[4, 5, 6, 7, 8], [], [35, 36, 37, 38, 39]]
