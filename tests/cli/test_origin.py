"""Foreign recordings of a fleet, each engine judged against its own early life, from the command line."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.physics.engine_file import load_engine

CONFIGS = Path(__file__).parents[2] / "configs"
ENGINE, RECORDER = CONFIGS / "cmapss_turbofan.yaml", CONFIGS / "recorders" / "cmapss.yaml"
CYCLES, WORN = 60, {"3": "hpc", "5": "fan"}
PSI, POUND = 6894.757293, 0.45359237


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    """Six engines in imperial units, in the last third of their life two of them with 1.5 % off a component."""
    engine, rng = load_engine(ENGINE), np.random.default_rng(1)
    worn = np.arange(CYCLES) >= 2 * CYCLES // 3
    head = (
        "unit cycle altitude_kft mach T2_degR T24_degR T30_degR T50_degR P2_psia P15_psia P30_psia Nf_rpm Nc_rpm "
        "phi_pps_psi Ps30_psia BPR W31_lbm_s W32_lbm_s"
    )
    rows = []
    for unit in "123456":
        inputs = {"altitude_m": np.zeros(CYCLES), "mach": 0.0, "dT_isa_K": 0.0, "N1_rpm": 2388.0}
        loss = 1 - 0.015 * worn
        theta = {f"{WORN[unit]}.{q}": loss for q in ("efficiency", "flow_capacity")} if unit in WORN else {}
        found = engine.predict(inputs, theta)
        sigma = np.array([s.noise_sigma for s in engine.sensors.values()])
        own = 1 + 0.002 * rng.standard_normal(len(sigma))  # engines differ from new
        y = dict(zip(found.columns, (found.y * own + sigma * rng.standard_normal(found.y.shape)).T, strict=True))
        for k in range(CYCLES):
            T = [y[c][k] * 1.8 for c in ("T25_K", "T3_K", "T5_K")]
            rows.append(
                [
                    unit,
                    k + 1,
                    0,
                    0,
                    518.67,
                    *T,
                    14.62,
                    21.61,
                    y["P3_Pa"][k] / PSI,
                    2388,
                    y["N2_rpm"][k],
                    y["Ps3_Pa"][k] / PSI,
                    y["fuel_ratio_kg_s_Pa"][k] * 3600 * PSI / POUND,
                    y["BPR"][k],
                    y["W31_kg_s"][k] / POUND,
                    y["W32_kg_s"][k] / POUND,
                ]
            )
    path = tmp_path_factory.mktemp("fleet") / "fleet.csv"
    with path.open("w", newline="") as stream:
        csv.writer(stream).writerows([head.split(), *rows])
    return path


@pytest.fixture
def nominal(fleet, run):
    path = fleet.with_name("nominal.yaml")
    if not path.exists():
        done = run(
            "identify", ENGINE, fleet, "--recorder", RECORDER, "--first", "20", "--no-cross-validation", "-o", path
        )
        assert done.exit_code == 0, done.stderr
    return path


def rows_of(done):
    assert done.exit_code == 0, done.stderr
    return list(csv.DictReader(line for line in done.stdout.splitlines() if not line.startswith("#")))


@pytest.mark.slow
def test_worn_engines_of_a_fleet_are_found_and_isolated_to_their_components(run, fleet, nominal):
    common = ("-n", nominal, fleet, "--recorder", RECORDER, "--reference", "20", "--last", "20", "--format", "csv")
    detected = rows_of(run("detect", *common))
    assert {r["engine"] for r in detected if r["verdict"] == "fault"} == set(WORN)
    assert [r["records"] for r in detected] == ["20"] * 6
    isolated = rows_of(run("isolate", *common, "--by", "component"))
    assert {r["engine"]: r["components"] for r in isolated if r["components"]} == WORN


def test_statistics_against_a_reference_can_be_piped(run, fleet, nominal):
    options = ("--recorder", RECORDER, "--engine-instance", "3", "--reference", "20", "--last", "20")
    condensed = run("residual", "-n", nominal, fleet, *options, "--format", "csv")
    assert "# reference: first 20" in condensed.stdout and "# judged: last 20" in condensed.stdout
    (row,) = rows_of(run("isolate", "-", "--by", "component", "--format", "csv", stdin=condensed.stdout))
    assert row["engine"] == "3" and "hpc" in row["components"]


def test_an_engine_that_is_not_in_the_recording_is_a_data_error(run, fleet, nominal):
    done = run("detect", "-n", nominal, fleet, "--recorder", RECORDER, "--engine-instance", "77")
    assert done.exit_code == 2 and "no record of engine '77'" in done.stderr


def test_components_come_from_the_posterior_only(run, fleet, nominal):
    done = run("isolate", "-n", nominal, fleet, "--recorder", RECORDER, "--by", "component", "--method", "minmax")
    assert done.exit_code == 2 and "--by component goes with --method posterior" in done.stderr


def test_engines_with_no_more_than_their_reference_end_without_verdict(run, fleet, nominal):
    done = run("detect", "-n", nominal, fleet, "--recorder", RECORDER, "--reference", str(CYCLES), "--format", "csv")
    assert done.exit_code == 3
    assert done.stdout.count("not more than the 60 of the reference") >= 6
