"""C-MAPSS FD001: 100 simulated turbofans run to failure, all by degradation of the HPC; FD002: at six conditions.

The maps of the engine in configs/ are generic, not those of the simulator: these tests pin down how far that goes.
"""

from __future__ import annotations

import gzip
from collections import Counter

import pytest
from ground_recordings import CONFIGS, enginediag, public_data, table

from enginediag_cli.identification.nominal_file import read_nominal
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.recorder_file import load_recorder

ENGINE = CONFIGS / "cmapss_turbofan.yaml"
RECORDER = CONFIGS / "recorders" / "cmapss.yaml"

pytestmark = pytest.mark.shared_data


@pytest.fixture(scope="module")
def fleet():
    """The recording of the 100 engines."""
    return public_data("cmapss") / "train_FD001.csv.gz"


@pytest.fixture(scope="module")
def nominal(fleet, tmp_path_factory):
    """Nominal state from the first 20 cycles of every engine."""
    path = tmp_path_factory.mktemp("cmapss") / "cmapss.yaml"
    enginediag("identify", ENGINE, fleet, "--recorder", RECORDER, "--first", "20", "--no-cross-validation", "-o", path)
    return path


def isolated(nominal, fleet, *options):
    """Components that changed, one entry per window."""
    out, _ = enginediag(
        "isolate", "-n", nominal, fleet, "--recorder", RECORDER, "--reference", "20", "--by", "component", *options
    )
    return table(out)


def test_the_recorder_refuses_a_file_in_which_the_two_names_are_not_swapped(fleet, tmp_path):
    from enginediag_cli.errors import DataError

    with gzip.open(fleet, "rt") as lines:
        head = [next(lines) for _ in range(30)]
    honest = head[0].replace("Ps30_psia,phi_pps_psi", "phi_pps_psi,Ps30_psia")
    assert honest != head[0]
    (tmp_path / "honest.csv").write_text(honest + "".join(head[1:]))
    with pytest.raises(DataError, match=r"phi is the static pressure at station 3.*not swapped"):
        load_recorder(RECORDER).read(tmp_path / "honest.csv")


def test_fuel_flow_is_that_of_a_turbofan_of_this_size(fleet):
    (mapped,) = load_recorder(RECORDER).read(fleet)
    assert mapped.masks.total == 0 and len(mapped.recording) == 20631
    pounds_per_hour = mapped.recording["Wf_kg_s"] / 0.45359237 * 3600
    assert 24_000 < pounds_per_hour.min() and pounds_per_hour.max() < 26_000


def test_early_life_is_predicted_to_within_the_noise(nominal):
    found = read_nominal(nominal)
    assert found.records["used"] == 2000
    assert not [e.name for e in found.estimates if e.status == "at bound"]
    rms = {q.sensor: q.rms for q in found.in_sample if q.regime == "all"}
    assert rms["T25_K"] < 0.2 and rms["T3_K"] < 2.4 and rms["T5_K"] < 2.4 and rms["N2_rpm"] < 4.5
    assert all(
        0.97 < e.value < 1.03 for e in found.estimates if e.family == "health"
    )  # the design point was sized to this fleet


@pytest.mark.slow
def test_every_engine_has_departed_at_the_end_of_its_life(nominal, fleet):
    out, _ = enginediag("detect", "-n", nominal, fleet, "--recorder", RECORDER, "--reference", "20", "--last", "20")
    assert [row["verdict"] for row in table(out)] == ["fault"] * 100


@pytest.mark.slow
def test_at_least_95_of_100_engines_are_isolated_to_the_hpc_at_the_end_of_life(nominal, fleet):
    rows = isolated(nominal, fleet, "--last", "20")
    assert len(rows) == 100 and Counter(row["components"] for row in rows)["hpc"] >= 95


@pytest.mark.slow
def test_the_hpc_is_still_named_when_every_sensor_may_be_wrong_too(nominal, fleet):
    monitored = [f"--monitor={name}" for name in (*load_engine(ENGINE).monitored, "sensor.*.bias")]
    rows = isolated(nominal, fleet, "--last", "20", *monitored, "--largest", "3")
    assert Counter(row["components"] for row in rows)["hpc"] >= 90


@pytest.mark.slow
def test_few_engines_are_called_faulty_in_their_second_twenty_cycles(nominal, fleet):
    out, _ = enginediag("detect", "-n", nominal, fleet, "--recorder", RECORDER, "--reference", "20", "--window", "20")
    second = {row["engine"]: row["verdict"] for row in reversed(table(out))}  # the first window of each engine
    # 1 expected at a false-alarm probability of 0.01; degradation has begun in some
    assert len(second) == 100 and Counter(second.values())["fault"] <= 8


@pytest.mark.slow
def test_the_hpc_is_named_less_surely_earlier_in_life(nominal, fleet):
    windows = isolated(nominal, fleet, "--window", "20")
    begin, end = {}, {}
    for row in windows:
        begin.setdefault(row["engine"], int(row["first_line"]) - 20)
        end[row["engine"]] = int(row["last_line"])
    named = {}
    for row in windows:
        first, last = begin[row["engine"]], end[row["engine"]]
        tenth = min(int(10 * (int(row["last_line"]) - first + 1) / (last - first + 1)), 9)
        named.setdefault(tenth, []).append(row["components"])
    share = {tenth: names.count("hpc") / len(names) for tenth, names in named.items()}
    assert share[9] > 0.95 and share[8] > 0.9 and share[7] > 0.7
    assert share[2] < 0.05  # nothing to be named yet


@pytest.mark.slow
def test_at_six_conditions_the_hpc_is_named_at_the_end_of_life_in_95_of_100_engines(tmp_path):
    """FD002: of fewer engines errors of the maps are known less well, and engines are told from each other less."""
    fleet, nominal = public_data("cmapss") / "train_FD002.csv.gz", tmp_path / "six.yaml"
    enginediag(
        "identify", ENGINE, fleet, "--recorder", RECORDER, "--first", "20", "--no-cross-validation", "-o", nominal
    )
    found = read_nominal(nominal)
    stated = load_engine(ENGINE).sensors
    assert all(n.sigma < 1.2 * stated[n.sensor].noise_sigma for n in found.noise)
    rows = isolated(nominal, fleet, "--last", "20")
    assert len(rows) == 260 and Counter(row["components"] for row in rows)["hpc"] >= 247
