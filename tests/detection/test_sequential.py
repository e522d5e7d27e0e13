"""Monitoring block by block: the bound on false alarms, delays, onset and kind of a change."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom, multivariate_normal
from toy_engine import toy_monitor, toy_recording
from white_statistics import white_noise

from enginediag_cli.detection.sequential import (
    RECENT,
    Coordinates,
    EProcess,
    Innovations,
    Segment,
    append_segment,
    change_equations,
    onset_chance,
)
from enginediag_cli.errors import DataError
from enginediag_cli.history.follow import FlightMonitor, StepEvidence, overshoot_factor
from enginediag_cli.history.hypotheses import SLAB_WEIGHTS, SLABS
from enginediag_cli.parameters import unspecified
from enginediag_cli.recordings.source import LONGEST_LINE, GrowingFile
from enginediag_cli.residuals.instruments import NoiseModel

KEY = ("toy.csv", "1", "")


def piece(first, G, z):
    return Segment(first, len(z), float(first), first + len(z) / 2, onset_chance(first, len(z)), G.T @ z, G.T @ G)


@pytest.mark.parametrize("block", [1, 7])
def test_the_chances_of_all_onsets_add_up_to_one(block):
    assert sum(onset_chance(j, block) for j in range(0, 10**6, block)) == pytest.approx(1.0, abs=1e-3)


def test_likelihood_ratios_are_those_of_the_gaussian_densities():
    rng = np.random.default_rng(1)
    G, z = rng.standard_normal((20, 5)), rng.standard_normal(20)
    found = change_equations([piece(0, G[:10], z[:10]), piece(10, G[10:], z[10:])], 2)
    W, late = G[:, :2], np.arange(20) >= 10
    base = np.eye(20) + W @ W.T
    D = G[:, 2:] * late[:, None]
    null = multivariate_normal(cov=base).logpdf(z)
    names = ("a", "b", "c")
    evidence = StepEvidence([unspecified(name) for name in names])
    told = np.logaddexp.reduce(
        [
            np.log(weight / 3) + multivariate_normal(cov=base + slab**2 * np.outer(D[:, j], D[:, j])).logpdf(z) - null
            for j in range(3)
            for slab, weight in zip(SLABS, SLAB_WEIGHTS, strict=True)
        ]
    )
    assert evidence(found)[1] == pytest.approx(told)


def test_memory_stays_bounded_and_sums_stay_what_they_are():
    rng, past, total = np.random.default_rng(2), [], 0.0
    for i in range(1000):
        s = rng.standard_normal(2)
        total = total + s
        past = append_segment(past, Segment(i, 1, float(i), float(i), onset_chance(i, 1), s, np.eye(2)))
    assert len(past) < 6 * RECENT
    assert [piece.first + piece.records for piece in past[:-1]] == [piece.first for piece in past[1:]]
    np.testing.assert_allclose(sum(piece.s for piece in past), total)


def test_innovations_of_correlated_noise_are_white_also_across_chunks_and_gaps():
    rng, rho = np.random.default_rng(3), np.array([0.9, 0.5])
    shocks = rng.standard_normal((20_000, 2)) * np.sqrt(1 - rho**2)
    e = np.column_stack([lfilter([1], [1, -r], shocks[:, j]) for j, r in enumerate(rho)])[500:]
    e[::7, 0] = np.nan
    stream, J = Innovations(NoiseModel(np.ones(2), rho)), np.ones((len(e), 2, 1))
    z = np.concatenate(
        [stream.compute(e[i : i + 11], J[i : i + 11], np.ones(len(e[i : i + 11])))[0] for i in range(0, len(e), 11)]
    )
    for j in range(2):
        x = z[z[:, j] != 0, j]
        assert x.std() == pytest.approx(1.0, abs=0.02)
        assert abs(np.mean(x[1:] * x[:-1])) < 0.03  # four standard errors


@pytest.mark.parametrize("x", [0.3, 1.0, 3.0])
def test_a_likelihood_ratio_exceeds_a_limit_by_the_stated_factor(x):
    rng, limit, ratio = np.random.default_rng(7), 100.0, np.zeros(4000)
    while (going := ratio < np.log(limit)).any():
        ratio[going] += x**2 / 2 + x * rng.standard_normal(int(going.sum()))
    share = limit * np.exp(-ratio)
    error = share.std() / np.sqrt(len(share))
    assert overshoot_factor(np.array([x]))[0] == pytest.approx(share.mean(), abs=4 * error + 0.01)


def process(alpha, k=2, a=3, m=2, overshoot=False):
    health, sensors = (tuple(map(unspecified, names)) for names in ("abc"[:a], "xy"[:m]))
    coordinates = Coordinates(np.eye(k + a + m) * 2.0, k, health, sensors, np.full(a + m, 2.0))
    evidence = StepEvidence(coordinates.described)
    G = 2.0 * np.random.default_rng(0).standard_normal((50, a + m))
    share = evidence.mean_overshoot(G[:, :, None] * G[:, None]) if overshoot else 1.0
    return EProcess(coordinates, evidence, alpha, share)


@pytest.mark.parametrize("noise, overshoot", [("gaussian", True), ("uniform", False)])
def test_healthy_flights_alarm_no_more_often_than_stated_over_their_whole_length(noise, overshoot):
    rng, alarms, flights = np.random.default_rng(4), 0, 300
    for _ in range(flights):
        watch, w = process(0.1, overshoot=overshoot), 2.0 * rng.standard_normal(2)  # nuisance as coordinates have it
        for block in range(25):
            G = rng.standard_normal((6, 1, 7))
            z = rng.standard_normal((6, 1)) if noise == "gaussian" else rng.uniform(-1, 1, (6, 1)) * np.sqrt(3)
            new = watch.segment(6 * block, 2.0 * G, z + G[:, :, :2] @ w, 0.0, 0.0)
            watch.add([], [*watch.open, new])
        alarms += watch.alarm_block is not None
    assert alarms <= binom.ppf(0.999, flights, 0.1)


def test_larger_faults_are_found_sooner():
    delays = []
    for change in (-0.005, -0.01, -0.03):
        rng = np.random.default_rng(5)
        flight = FlightMonitor(toy_monitor(), KEY, 0.01)
        for block in range(40):
            part = toy_recording(rng, 20, change={"hpc.efficiency": change if block >= 15 else 0.0})
            flight.add(part)
        assert flight.process.alarm_block is not None and flight.process.alarm_block >= 15
        delays.append(flight.process.alarm_block - 15)
    assert delays == sorted(delays, reverse=True) and delays[-1] <= 1


def followed(law, monitor=None, blocks=40, seed=6, records=20):
    """Last report of a flight in which something changes from block 15 on."""
    rng, flight, report = np.random.default_rng(seed), FlightMonitor(monitor or toy_monitor(rho=0.5), KEY, 0.01), None
    for block in range(blocks):
        change, shift = law(block)
        part = toy_recording(rng, records, change={"hpc.efficiency": change}, shift=shift)
        part.columns["time_s"][:] += block * records * 10.0
        report = flight.add(part)
    return report


def test_a_sudden_fault_is_told_with_its_onset():
    change = followed(lambda block: (-0.02 if block >= 15 else 0.0, None)).change
    assert (change.kind, change.parameter) == ("step", "hpc.efficiency")
    assert change.low_s <= 3000 <= change.high_s and change.high_s - change.low_s <= 800


def test_gradual_deterioration_is_told_from_a_sudden_fault():
    change = followed(lambda block: (-0.03 * max(block - 15, 0) / 25, None)).change
    assert change.kind == "deterioration"
    assert change.low_s <= 3000 <= change.high_s


def test_a_sensor_jump_is_told_from_a_fault():
    jump = np.array([0.0, 0.0, 8.0, 0.0, 0.0])
    change = followed(lambda block: (0.0, jump if block >= 15 else None)).change
    assert (change.kind, change.parameter) == ("step", "sensor.T5.bias")


def test_a_change_that_was_there_before_has_no_onset():
    assert followed(lambda block: (-0.02, None)).change.kind == "from start"


def test_a_growing_file_is_read_to_its_end_and_on(tmp_path):
    path, waits = tmp_path / "grow.csv", []
    path.write_text("a\n1\n2")

    def wait(seconds):
        waits.append(seconds)
        if len(waits) == 1:
            with path.open("a") as stream:
                stream.write("3\n4\n")

    assert list(GrowingFile(str(path), 0.5, wait)) == ["a\n", "1\n", "23\n", "4\n"]


@pytest.mark.parametrize("way", ["renamed", "cut"])
def test_a_growing_file_is_followed_by_its_name(tmp_path, way):
    path, waits = tmp_path / "grow.csv", []
    path.write_text("# by x\na\n1\n2\n3\n")

    def wait(seconds):
        waits.append(seconds)
        if len(waits) == 1:
            if way == "renamed":
                path.rename(tmp_path / "grow.csv.1")
            path.write_text("# by x\na\n4\n")

    assert list(GrowingFile(str(path), 0.5, wait)) == ["# by x\n", "a\n", "1\n", "2\n", "3\n", "4\n"]


def test_white_innovations_are_whitened_residuals():
    e, J = np.array([[2.0, np.nan]]), np.ones((1, 2, 1))
    z, G = Innovations(white_noise(np.array([2.0, 1.0]))).compute(e, J, np.ones(1))
    np.testing.assert_array_equal(z, [[1.0, 0.0]])
    np.testing.assert_array_equal(G[:, :, 0], [[0.5, 0.0]])


def test_what_is_no_text_in_a_growing_file_is_a_line_that_a_reader_passes_over(tmp_path):
    path = tmp_path / "grow.csv"
    path.write_bytes(b"a\n1\n\xff\x00\xfe\n" + b"x" * (3 * LONGEST_LINE) + b"\n2\n")
    lines = list(GrowingFile(str(path), 0.0, lambda seconds: None))
    assert (lines[:2], lines[-1]) == (["a\n", "1\n"], "2\n")
    assert len(lines) == 5 and all("\ufffd" in line and len(line) <= LONGEST_LINE + 1 for line in lines[2:4])
    path.write_bytes(b"\xff\xfea\n1\n")
    with pytest.raises(DataError, match="the header is no UTF-8 text"):
        list(GrowingFile(str(path), 0.0, lambda seconds: None))


def disturbed(seed, block, begin, records, *, shift=None, change=0.0, spoil=None):
    """E in powers of ten, and the block of the alarm, of a flight in which readings shift, and health changes, for some
    records from one on."""
    rng, flight = np.random.default_rng(seed), FlightMonitor(toy_monitor(), KEY, 0.01)
    y = toy_recording(rng, 100)
    later = toy_recording(np.random.default_rng(seed), 100, change={"hpc.efficiency": change}, shift=shift)
    rows = slice(begin, begin + records)
    for c in y.columns:
        y.columns[c][rows] = later.columns[c][rows]
    y.columns["time_s"][:] = 60.0 * np.arange(100)
    if spoil is not None:
        column, factor = spoil
        y.columns[column][rows] *= factor
    reports = [flight.add(y.select(slice(i, i + block))) for i in range(0, 100, block)]
    return reports, flight


@pytest.mark.parametrize("block", [1, 5, 20])
@pytest.mark.parametrize("begin", [0, 3, 50])
def test_no_alarm_rests_on_a_burst_of_one_sensor(block, begin):
    shift = np.array([0.0, 0.0, 25.0, 0.0, 0.0])
    reports, flight = disturbed(20 + begin, block, begin, 5, shift=shift)
    assert flight.process.alarm_block is None
    assert reports[-1].log10_e < 1
    reports, _ = disturbed(20 + begin, block, begin, 100, shift=shift)  # but on what lasts
    first = next(k for k, report in enumerate(reports) if report.alarm)
    assert (first + 1) * block - begin <= 8 + 2 * block


@pytest.mark.parametrize("block", [5, 20])
def test_a_fault_that_several_sensors_show_from_the_start_is_seen_in_the_first_block(block):
    reports, _ = disturbed(30, block, 0, 100, change=-0.03)
    assert reports[0].alarm


def test_a_block_in_which_one_channel_alone_decides_says_so():
    reports, _ = disturbed(31, 5, 0, 5, shift=np.array([0.0, 0.0, 25.0, 0.0, 0.0]))
    assert "without T5_K there is no alarm" in reports[0].reason and not reports[0].alarm
    assert reports[-1].reason == ""


@pytest.mark.parametrize("spoilt", [False, True])
def test_a_flight_too_short_to_show_gross_errors_is_judged_at_its_end(spoilt):
    flight = FlightMonitor(toy_monitor(), KEY, 0.01)
    part = toy_recording(np.random.default_rng(32), 3, change={} if spoilt else {"hpc.efficiency": -0.08})
    if spoilt:
        part.columns["T3_K"][1] += 40.0
    first = flight.add(part)
    assert first.judged == 0 and not first.alarm
    last = flight.finish()
    assert last is not None and (last.records, last.judged) == (0, 3)
    assert last.alarm is not spoilt
    assert ("without T3_K" in last.reason) is spoilt
