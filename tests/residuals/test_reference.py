"""Engines judged against their own early records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from toy_engine import HEALTH, SENSORS, toy_monitor, toy_recording

from enginediag_cli.detection.verdict import judge
from enginediag_cli.recordings.table import concat
from enginediag_cli.residuals.files import last_records, learn_reference, windows_against_reference
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.windows import WindowPlan

OWN = {"fan.efficiency": -0.006, "hpc.flow_capacity": 0.004}
"""How the engine of these tests differs from its type from the beginning."""


def life(rng, early=40, later=40, change=None, flight="0", source="toy.csv"):
    """Early records of an engine with its own differences, then later ones with a further change."""
    worn = {n: OWN.get(n, 0.0) + (change or {}).get(n, 0.0) for n in HEALTH}
    both = concat(
        [toy_recording(rng, early, change=OWN, source=source), toy_recording(rng, later, change=worn, source=source)]
    )
    columns = {**both.columns, "time_s": np.arange(len(both)) * 10.0}
    return replace(both, columns=columns, text={"flight": [flight] * len(both)}, line=np.arange(2, len(both) + 2))


def against(recordings, records=40, **options):
    recordings = recordings if isinstance(recordings, list) else [recordings]
    return list(windows_against_reference(toy_monitor(), recordings, WindowPlan(), records, **options))


def test_the_reference_is_the_gaussian_posterior_of_what_is_uncertain():
    rng = np.random.default_rng(1)
    A = rng.standard_normal((30, 4))
    F, C = A.T @ A, np.diag([0.5, 2.0, 0.0, 1.0])
    s = rng.standard_normal(4)
    statistics = LocalStatistics(
        parameters=("a", "b", "c", "d"),
        theta0=np.zeros(4),
        prior_sigma=np.ones(4),
        s=s,
        F=F,
        V=F,
        n=30,
        chi2=30.0,
        dof=30.0,
    )
    found = learn_reference(statistics, C)
    gain = C @ np.linalg.inv(np.eye(4) + F @ C)
    np.testing.assert_allclose(found.shift, gain @ s, atol=1e-12)
    np.testing.assert_allclose(found.uncertainty, gain, atol=1e-12)
    assert found.shift[2] == 0.0  # what is certain is not re-estimated


def test_taking_the_reference_out_is_the_same_as_subtracting_its_prediction_from_every_reading():
    rng = np.random.default_rng(2)
    G, z, shift = rng.standard_normal((50, 3)), rng.standard_normal(50), rng.standard_normal(3)
    F = G.T @ G

    def of(z):
        return LocalStatistics(
            parameters=("a", "b", "c"),
            theta0=np.zeros(3),
            prior_sigma=np.ones(3),
            s=G.T @ z,
            F=F,
            V=F,
            n=50,
            chi2=float(z @ z),
            dof=50.0,
        )

    reference = replace(learn_reference(of(z), np.eye(3)), shift=shift)
    moved, direct = reference.subtract_shift(of(z)), of(z - G @ shift)
    np.testing.assert_allclose(moved.s, direct.s)
    assert moved.chi2 == pytest.approx(direct.chi2)


def test_an_engine_that_differs_from_its_type_is_healthy_against_itself_and_its_change_is_found():
    rng = np.random.default_rng(3)
    assert judge(against(life(rng), 0)[0]).verdict == "fault"
    (same,) = against(life(rng))
    (worse,) = against(life(rng, change={"hpc.efficiency": -0.02}))
    assert judge(same).verdict == "healthy" and same.records == 40
    assert judge(worse).verdict == "fault"


def test_false_alarms_against_a_short_reference_keep_to_their_probability():
    # 300 engines at 5 %: 15 expected, standard deviation 3.8; the reference's own error must be counted
    rng = np.random.default_rng(4)
    engines = [life(rng, 20, 20, flight=str(k)) for k in range(300)]
    windows = against([concat(engines)], 20)
    alarms = sum(judge(w, 0.05).test.alarm for w in windows)
    assert len(windows) == 300 and 4 <= alarms <= 28


def test_chunks_of_a_stream_give_the_windows_of_the_whole_file():
    rng = np.random.default_rng(5)
    both = concat([life(rng, 20, 30, flight="a"), life(rng, 20, 25, flight="b")])
    whole = against(both, 20, last=10)
    chunks = against([both.select(slice(i, i + 7)) for i in range(0, len(both), 7)], 20, last=10)
    assert [(w.flight, w.records, w.first_line) for w in whole] == [("a", 10, 42), ("b", 10, 37)]
    for a, b in zip(whole, chunks, strict=True):
        np.testing.assert_allclose(a.statistics.s, b.statistics.s, rtol=1e-6, atol=1e-9)


def test_an_engine_without_records_after_its_reference_has_no_verdict_and_says_why():
    rng = np.random.default_rng(6)
    short, long = life(rng, 15, 5, flight="short"), life(rng, 20, 5, flight="long")
    windows = against(concat([short, long]), 20)
    assert {w.flight: w.reason for w in windows} == {
        "long": "",
        "short": "20 records are not more than the 20 of the reference",
    }


def test_an_engine_whose_early_records_cannot_be_computed_has_no_verdict():
    recording = life(np.random.default_rng(7), 20, 20)
    altitude = recording["altitude_m"].copy()
    altitude[:20] = 13.5e3  # where the toy engine does not converge
    (window,) = against(recording.with_columns({"altitude_m": altitude}), 20)
    assert window.statistics is None and "give no reference" in window.reason


def test_the_last_records_of_each_engine_and_file_come_in_the_order_of_the_file():
    rng = np.random.default_rng(8)
    one = concat([life(rng, 10, 0, flight="a"), life(rng, 3, 0, flight="b")])
    other = life(rng, 6, 0, source="other.csv")
    found = list(last_records([one.select(slice(0, 8)), one.select(slice(8, None)), other], 4))
    assert [(r.source, list(r.text["flight"])) for r in found] == [
        ("toy.csv", ["a"] * 4 + ["b"] * 3),
        ("other.csv", ["0"] * 4),
    ]
    np.testing.assert_array_equal(found[0]["T3_K"][:4], one["T3_K"][6:10])


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_scale_error_that_was_there_from_the_beginning_is_no_change(sensor):
    recording = life(np.random.default_rng(9))
    wrong = recording.with_columns({sensor: 1.01 * recording[sensor]})
    assert judge(against(wrong)[0]).verdict == "healthy"
