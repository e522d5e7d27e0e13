"""Two JT15D turbofans on real flights: identified on one flight, watched through another.

Flight b22 holds a state that nobody recorded and that switches on both engines at once. There is no label: the
checks are the other engine, the flight that was identified, and the raw steps of fuel flow and ITT.
"""

from __future__ import annotations

import pytest
from ground_recordings import CONFIGS, enginediag, public_data, table

from enginediag_cli.identification.nominal_file import read_nominal

ENGINE = CONFIGS / "citation_jt15d.yaml"
RECORDER = CONFIGS / "recorders" / "citation_jt15d.yaml"
SIDES = ("left", "right")
HELD_OUT = 0.25
N2_POINT_RPM = 327.6
"""One point of N2: 1 % of its 100 % speed."""

STEPS_S = (1476.0, 2337.0, 2626.0, 3660.0, 4051.0)
"""Raw steps of both engines' fuel flow and ITT in flight b22: off, on, off, on, off."""

RECORD_S = 10.0

pytestmark = pytest.mark.shared_data


@pytest.fixture(scope="module")
def flights():
    """Folder of the recordings."""
    return public_data("c550_jt15d")


def identify(flights, folder, side, *options):
    path = folder / f"{side}.yaml"
    enginediag(
        "identify",
        ENGINE,
        flights / "flight_ref.csv",
        "--recorder",
        RECORDER,
        "--engine-instance",
        side,
        *options,
        "-o",
        path,
    )
    return path


@pytest.fixture(scope="module")
def identified(flights, tmp_path_factory):
    """Nominal file of each engine, the last quarter of the flight held out."""
    folder = tmp_path_factory.mktemp("citation")
    return {side: identify(flights, folder, side, "--holdout", str(HELD_OUT)) for side in SIDES}


def verdicts(flights, nominal, side, flight):
    """Start of each 10 s record: its row of `detect`."""
    out, _ = enginediag(
        "detect",
        "--must-show",
        "none",
        "-n",
        nominal,
        flights / flight,
        "--recorder",
        RECORDER,
        "--engine-instance",
        side,
        "--window",
        f"{RECORD_S:g}s",
    )
    return {float(row["start_s"]): row for row in table(out)}


@pytest.fixture(scope="module")
def watched(flights, identified):
    """Verdicts of each engine through flight b22."""
    return {side: verdicts(flights, identified[side], side, "flight_b22.csv") for side in SIDES}


def rms(nominal_path, judged):
    """RMS of N2 in points, ITT in K and fuel flow in per cent."""
    found = {q.sensor: q.rms for q in getattr(read_nominal(nominal_path), judged) if q.regime == "all"}
    return found["N2_rpm"] / N2_POINT_RPM, found["ITT_K"], found["Wf_kg_s"]


def judged_by_both(watched):
    left, right = (watched[side] for side in SIDES)
    return [t for t in left if t in right and "no verdict" not in (left[t]["verdict"], right[t]["verdict"])]


@pytest.mark.parametrize("side", SIDES)
def test_the_model_reproduces_what_it_was_fitted_to(identified, side):
    N2, ITT, Wf = rms(identified[side], "in_sample")
    assert N2 <= 0.09 and ITT <= 3.0 and Wf <= 0.45


@pytest.mark.parametrize("side", SIDES)
def test_contiguous_blocks_left_out_are_predicted(identified, side):
    """Worst where a block takes all records of low power away, as with three quarters of the flight: errors of the maps
    begin anew there, as they do for whoever has no other records."""
    N2, ITT, Wf = rms(identified[side], "cross_validated")
    assert N2 <= 0.36 and ITT <= 6.0 and Wf <= 1.3


@pytest.mark.parametrize("side", SIDES)
def test_contiguous_blocks_left_out_are_predicted_within_a_third_of_a_point(identified, side):
    N2, _, Wf = rms(identified[side], "cross_validated")
    assert N2 <= 0.31 and Wf <= 1.2


@pytest.mark.parametrize("side", SIDES)
def test_the_quarter_of_the_flight_held_out_is_predicted_within_half_a_per_cent_more(identified, side):
    N2, ITT, Wf = rms(identified[side], "held_out")
    assert N2 <= 0.23 and ITT <= 6.0 and Wf <= 1.0


@pytest.mark.parametrize("side", SIDES)
def test_the_reference_flight_raises_no_alarm_in_the_part_held_out_either(flights, identified, side):
    rows = verdicts(flights, identified[side], side, "flight_ref.csv")
    assert len(rows) > 290
    held_out = list(rows.values())[-round(HELD_OUT * len(rows)) :]
    assert sum(row["verdict"] == "healthy" for row in held_out) > 0.6 * len(held_out)
    assert not [t for t, row in rows.items() if row["verdict"] == "fault"]


def test_left_and_right_engine_give_the_same_verdict(watched):
    both = judged_by_both(watched)
    same = [t for t in both if watched["left"][t]["verdict"] == watched["right"][t]["verdict"]]
    assert len(both) > 140
    assert len(same) >= 0.98 * len(both)


@pytest.mark.parametrize("side", SIDES)
def test_every_interval_in_which_both_engines_depart_is_found(watched, side):
    """Judged records that lie wholly within a state, a soak of two records after its step left out. Where a gross
    reading is lost the others may be silent: the right engine's first record, of turbines that are not yet warm, has no
    verdict unless silence is believed, as it is here."""
    off_1, on_2, off_2, on_3, off_3 = STEPS_S
    intervals = (
        ("fault", 0.0, off_1),
        ("healthy", off_1, on_2),
        ("fault", on_2, off_2),
        ("healthy", off_2, on_3),
        ("fault", on_3, off_3),
    )
    for state, begin, end in intervals:
        inside = [
            row["verdict"]
            for t, row in watched[side].items()
            if begin + 2 * RECORD_S <= t < end - RECORD_S
            and row["verdict"] != "no verdict"
            and not (row["gross_readings"] != "0" and row["verdict"] == "healthy")
        ]
        assert len(inside) >= 8
        assert set(inside) == {state}, (state, begin)


def test_records_outside_the_operating_points_seen_have_no_verdict_unless_they_alarm(watched):
    """Limits are wider there: what exceeds them all the same is reported, silence is not. A
    record that departs alone, or with few in ten minutes, is a gross error and not judged."""
    for side in SIDES:
        unjudged = [row for row in watched[side].values() if row["verdict"] == "no verdict"]
        assert 0 < len(unjudged) < 80
        lost = [row for row in unjudged if row["incomplete"] == "1"]
        assert len(lost) <= 2
        assert all("outside the operating points" in row["reason"] for row in unjudged if row not in lost)
        assert not any(row["alarm"] == "true" for row in unjudged)


@pytest.mark.slow
@pytest.mark.parametrize("side", SIDES)
def test_the_whole_flight_is_reproduced_as_well(flights, tmp_path, side):
    nominal = identify(flights, tmp_path, side)
    N2, ITT, Wf = rms(nominal, "in_sample")
    assert N2 <= 0.09 and ITT <= 3.0 and Wf <= 0.45
    N2, ITT, Wf = rms(nominal, "cross_validated")
    assert N2 <= 0.2 and ITT <= 6.0 and Wf <= 0.7


@pytest.mark.slow
@pytest.mark.xfail(reason="0.18 and 0.17 points: a climb that is left out is not told by the cruise", strict=True)
@pytest.mark.parametrize("side", SIDES)
def test_blocks_of_the_whole_flight_that_are_left_out_are_predicted_within_an_eighth_of_a_point(
    flights, tmp_path, side
):
    N2, _, _ = rms(identify(flights, tmp_path, side), "cross_validated")
    assert N2 <= 0.12
