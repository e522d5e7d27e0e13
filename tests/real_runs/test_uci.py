"""A real power-plant turbine: identified on 2011, watched through 2012. What is found, and what is not explained.

The machine has inlet guide vanes that nobody recorded and the model does not have; these tests pin down what that
costs, so that a model with vanes can show what it gains.
"""

from __future__ import annotations

import numpy as np
import pytest
from ground_recordings import CONFIGS, enginediag, public_data, table

from enginediag_cli.error_model.sizes import LARGEST
from enginediag_cli.identification.nominal_file import read_nominal
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.recorder_file import load_recorder

ENGINE = CONFIGS / "power_plant.yaml"
ALL_HOURS = CONFIGS / "recorders" / "uci_gas_turbine.yaml"
BASE_LOAD = CONFIGS / "recorders" / "uci_gas_turbine_base_load.yaml"
HALF_A_DAY = ("--window", "12")

pytestmark = pytest.mark.shared_data


@pytest.fixture(scope="module")
def uci():
    """Folder of the recordings of 2011 and 2012."""
    return public_data("uci_gas_turbine")


@pytest.fixture(scope="module")
def identified(uci, tmp_path_factory):
    """Nominal files of 2011: of base load, with 2012 held out, and of all hours."""
    folder = tmp_path_factory.mktemp("uci")
    year = uci / "gt_2011.csv"
    enginediag(
        "identify",
        ENGINE,
        year,
        uci / "gt_2012.csv",
        "--holdout-last",
        "--recorder",
        BASE_LOAD,
        "-o",
        folder / "base.yaml",
    )
    enginediag("identify", ENGINE, year, "--recorder", ALL_HOURS, "--no-cross-validation", "-o", folder / "all.yaml")
    return {name: folder / f"{name}.yaml" for name in ("base", "all")}


def rms(nominal_path, judged="cross_validated"):
    """RMS of each sensor: per cent, or K for temperatures."""
    return {q.sensor: q.rms for q in getattr(read_nominal(nominal_path), judged) if q.regime == "all"}


def at_bound(nominal_path):
    return {e.name for e in read_nominal(nominal_path).estimates if e.status == "at bound"}


def test_base_load_is_reproduced_as_well_as_unrecorded_vanes_allow(identified):
    """A free regression on ambient temperature, pressure and humidity leaves 1.5 %, 2.9 K, 1.5 % (2011)."""
    found = rms(identified["base"])
    assert found["P3_Pa"] < 1.5
    assert found["T5_K"] < 3.3
    assert found["power_W"] < 1.9
    assert found["dP_exhaust_Pa"] < 3.2


def test_the_next_year_is_predicted_as_well_as_with_maps_that_are_trusted(identified):
    """1.40 %, 3.4 K, 1.7 %, 3.2 % with `--model-error 0`: what hours of one year share is not taken up by the maps."""
    found = rms(identified["base"], "held_out")
    assert found["P3_Pa"] < 1.5
    assert found["T5_K"] < 3.5
    assert found["power_W"] < 1.7
    assert found["dP_exhaust_Pa"] < 3.3


def test_no_parameter_ends_at_a_bound_although_vanes_are_missing(identified):
    assert not at_bound(identified["base"])
    assert not at_bound(identified["all"])


def test_one_engine_without_vanes_fits_all_hours_only_with_a_compressor_map_far_more_wrong_than_stated(identified):
    """Flow at constant speed follows the vanes, which no column has: three times what is stated, or as much as is
    believable."""
    found = read_nominal(identified["all"]).error_model
    assert 2.5 * found.stated < found.sizes["compressor.flow_capacity"] <= LARGEST * found.stated
    base = read_nominal(identified["base"]).error_model
    assert max(base.sizes.values()) < 2 * base.stated


def test_the_engine_of_base_load_misses_part_load_the_way_closed_vanes_would(identified, uci):
    """At part load pressure and flow are far lower, and the exhaust hotter, than TIT alone would make them."""
    [mapped] = load_recorder(ALL_HOURS).read(uci / "gt_2011.csv")
    part = mapped.recording.select(mapped.recording["T4_K"] < 1343.0)
    engine = load_engine(ENGINE)
    inputs = {c: part[c] for c in (*engine.inputs, *engine.optional_inputs)}
    nominal = read_nominal(identified["base"])
    p = nominal.error_model.wrap(engine).predict(inputs, nominal.theta0, sensors=["P3_Pa", "T5_K", "power_W"])
    assert p.ok.all()
    assert np.median(part["P3_Pa"] / p.y[:, 0] - 1.0) < -0.10
    assert np.median(part["T5_K"] - p.y[:, 1]) > 15.0
    assert np.median(part["power_W"] / p.y[:, 2] - 1.0) < -0.10


def test_few_half_days_of_base_load_alarm_in_2012(identified, uci):
    """More than the 1 % asked for, and no more than in the year of training: the vanes wander."""
    how = ("--recorder", BASE_LOAD, *HALF_A_DAY, "--must-show", "none")
    out, _ = enginediag("detect", "-n", identified["base"], uci / "gt_2012.csv", *how)
    verdicts = [row["verdict"] for row in table(out)]
    judged = sum(v != "no verdict" for v in verdicts)
    assert judged >= 50
    assert verdicts.count("fault") <= 0.10 * judged


def test_of_the_day_of_2012_with_less_power_at_full_temperature_the_compressor_is_the_first_suspect(identified, uci):
    """Lines 2659 to 2684: 148 MW where the hours before and after make 156 and 155, at the same TIT and outside air.
    With maps that are generic it is not told for certain."""
    out, _ = enginediag("isolate", "-n", identified["base"], uci / "gt_2012.csv", "--recorder", BASE_LOAD, *HALF_A_DAY)
    rows = [r for r in table(out) if int(r["first_line"]) <= 2684 and int(r["last_line"]) >= 2664]
    assert rows and all(r["verdict"] == "fault" for r in rows)
    first = {r["isolated"] or r["rivals"].partition(" (")[0] for r in rows}
    assert first == {"compressor.flow_capacity"}


def test_part_load_is_not_judged_by_the_engine_of_base_load(identified, uci):
    how = ("--recorder", ALL_HOURS, *HALF_A_DAY, "--must-show", "none")
    out, err = enginediag("detect", "-n", identified["base"], uci / "gt_2012.csv", *how)
    rows = table(out)
    outside = sum(int(r["outside"]) for r in rows) / sum(int(r["records"]) for r in rows)
    assert outside > 0.75
    assert "outside the operating points identified, too far to be judged: T4_K in" in err
    assert sum(r["verdict"] == "no verdict" for r in rows) > 0.4 * len(rows)
