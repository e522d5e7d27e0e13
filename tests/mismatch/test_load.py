"""Evidence out of files: flights, nuisance, priors, noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from enginediag_cli.errors import DataError
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.intake.selection import RecordingSource
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.load import SCALE_SIGMA, MismatchQuery, RecordedCase, build_dataset, load_case
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.shipped import shipped

TURBOFAN = str(shipped("turbofan.yaml"))
HEAD = "engine,flight,altitude_m,mach,dT_isa_K,Wf_kg_s,N1_rpm,T3_K,valve"


@pytest.fixture(scope="module")
def engine():
    return load_engine(TURBOFAN)


def rows(engine_name: str, flight: str, count: int = 3, T3: str = "700.5") -> list[str]:
    return [f"{engine_name},{flight},{9000 + k},0.7,0,0.9,{3300 + k},{T3},{k % 2}" for k in range(count)]


@pytest.fixture
def fleet(tmp_path):
    path = tmp_path / "fleet.csv"
    lines = [*rows("A", "1"), *rows("A", "2"), *rows("B", "1")]
    path.write_text("\n".join([HEAD, *lines]) + "\n", encoding="utf-8")
    return str(path)


def edited(engine, **blocks):
    """The engine with other blocks in its file."""
    declared = {**engine.declared, **blocks}
    return type(engine)(engine.network, declared, engine.path)


def flight(engine, **columns) -> Flight:
    n = 4
    base = {
        "altitude_m": np.full(n, 9000.0),
        "mach": np.full(n, 0.7),
        "dT_isa_K": np.zeros(n),
        "Wf_kg_s": np.full(n, 0.9),
        "N1_rpm": np.full(n, 3300.0),
    }
    return Flight("f", "", {**base, **columns})


def test_engines_and_flights_of_a_file_are_flights_of_their_engine(fleet):
    evidence = load_case(RecordedCase(TURBOFAN, RecordingSource((fleet,)))).evidence
    assert [(f.engine, f.label) for f in evidence.flights] == [
        ("A", "fleet.csv engine A flight 1"),
        ("A", "fleet.csv engine A flight 2"),
        ("B", "fleet.csv engine B flight 1"),
    ]
    assert evidence.engines == ("A", "B")


def test_one_engine_can_be_chosen_and_one_that_is_not_there_is_refused(fleet):
    evidence = load_case(RecordedCase(TURBOFAN, RecordingSource((fleet,), engine_instance="B"))).evidence
    assert evidence.engines == ("B",)
    with pytest.raises(DataError, match=r"no record of engine 'C' \(A, B\)"):
        load_case(RecordedCase(TURBOFAN, RecordingSource((fleet,), engine_instance="C")))


def test_several_files_are_flights_of_one_engine(tmp_path):
    paths = []
    for name, T3 in (("a.csv", "700.0"), ("b.csv", "701.0")):
        path = tmp_path / name
        records = (r.split(",", 2)[2] for r in rows("", "", T3=T3))
        path.write_text(
            "\n".join([HEAD.removeprefix("engine,flight,"), *records]) + "\n",
            encoding="utf-8",
        )
        paths.append(str(path))
    evidence = load_case(RecordedCase(TURBOFAN, RecordingSource(tuple(paths)))).evidence
    assert [f.label for f in evidence.flights] == ["a.csv", "b.csv"]
    assert evidence.engines == ("",)


def test_default_nuisance_is_monitored_health_and_scale_errors_of_what_is_recorded(engine, fleet):
    sigma = load_case(RecordedCase(TURBOFAN, RecordingSource((fleet,)))).evidence.settings.nuisance
    assert set(sigma) == {*engine.monitored, "sensor.N1.scale", "sensor.T3.scale"}
    assert sigma["sensor.T3.scale"] == SCALE_SIGMA
    assert sigma["hpc.efficiency"] == engine.parameters["hpc.efficiency"].prior_sigma


def test_the_identification_block_decides_what_is_nuisance_and_how_loosely(engine):
    from enginediag_cli.identification.problem import IDENTIFICATION

    block = {f.name: f.default for f in IDENTIFICATION.fields}
    block |= {
        "parameters": ["hpc.*", "sensor.N1.*"],
        "fixed": ["hpc.map.*"],
        "prior_sigma": {"hpc.efficiency": 0.07},
        "noise_sigma": {"N1_rpm": 12.0},
        "recording_bias_sigma": {"N1_rpm": 4.0, "T3_K": 1.0},
        "loss": "none",
    }
    evidence = build_dataset(edited(engine, identification=block), [flight(engine)])
    assert evidence.settings.nuisance == {
        "hpc.efficiency": 0.07,
        "hpc.flow_capacity": engine.parameters["hpc.flow_capacity"].prior_sigma,
        "sensor.N1.bias": engine.parameters["sensor.N1.bias"].prior_sigma,
        "sensor.N1.scale": engine.parameters["sensor.N1.scale"].prior_sigma,
    }
    assert evidence.noise.sigma == {"N1_rpm": 12.0}
    assert evidence.settings.offsets == {"N1_rpm": 4.0}  # T3 is not recorded


def test_the_mismatch_block_goes_before_identification(engine):
    block = {
        "nuisance": ["lpt.*iency"],
        "prior_sigma": {"lpt.efficiency": 0.01},
        "map_accuracy": 0.01,
        "noise": "estimate",
    }
    evidence = build_dataset(edited(engine, mismatch=block), [flight(engine)])
    assert evidence.settings.nuisance == {"lpt.efficiency": 0.01}
    assert evidence.settings.map_accuracy == 0.01
    assert evidence.settings.noise == "estimate"
    trusted = build_dataset(edited(engine, mismatch=block), [flight(engine)], MismatchQuery(model_error=0.0))
    assert trusted.settings.map_accuracy == 0.0


def test_an_unknown_name_in_the_mismatch_block_is_refused_with_a_near_match(engine):
    block = {"nuisance": ["hpc.eficiency"], "prior_sigma": {}, "map_accuracy": 0.003, "noise": "specified"}
    with pytest.raises(DataError, match=r"unknown parameter 'hpc\.eficiency' \(did you mean 'hpc\.efficiency'"):
        build_dataset(edited(engine, mismatch=block), [flight(engine)])


def test_the_block_is_checked_where_it_stands_in_the_file(tmp_path):
    from enginediag_cli.errors import ConfigError

    text = shipped("turbofan.yaml").read_text(encoding="utf-8")
    path = tmp_path / "engine.yaml"
    path.write_text(text + "\nmismatch:\n  map_acuracy: 0.01\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"engine.yaml:\d+:3.*map_acuracy"):
        load_engine(path)
    path.write_text(text + "\nmismatch:\n  map_accuracy: 0.02\n", encoding="utf-8")
    assert build_dataset(load_engine(path), [flight(load_engine(path))]).settings.map_accuracy == 0.02


def test_a_nominal_state_is_where_priors_are_centred_and_what_is_not_nuisance_is_held_there(engine):
    rng = np.random.default_rng(0)
    n = 40
    u = {"altitude_m": rng.uniform(3000, 11000, n), "mach": rng.uniform(0.4, 0.8, n), "dT_isa_K": rng.normal(0, 8, n)}
    u["Wf_kg_s"] = engine.power_from_fraction(rng.uniform(0.5, 1, n), u)
    y = engine.predict(u, {"hpc.efficiency": 0.98, "sensor.T3.bias": 6.0})
    columns = {
        **u,
        **{c: y.y[:, j] + engine.sensors[c].noise_sigma * rng.standard_normal(n) for j, c in enumerate(y.columns)},
    }
    nominal = identify(engine, [TrainingRecording("f", columns)], cross_validation=False).nominal("", "", {})
    evidence = build_dataset(engine, [Flight("f", "", columns)], nominal=nominal)
    theta0 = nominal.engine_values  # what the maps are wrong by is the floor's to say here
    assert nominal.error_model is not None and set(theta0) <= set(engine.parameters)
    assert evidence.settings.prior_mean["hpc.efficiency"] == theta0["hpc.efficiency"]
    assert "sensor.T3.bias" not in evidence.settings.nuisance
    assert evidence.engine.parameters["sensor.T3.bias"].nominal == theta0["sensor.T3.bias"]
    held = {k: v for k, v in theta0.items() if k not in evidence.settings.nuisance}
    assert np.array_equal(evidence.engine.predict(u).y, engine.predict(u, held).y)
    # and an effect that is added later leaves it so
    from enginediag_cli.physics.registry import effect

    other = evidence.engine.replace_effects([effect(engine, "reynolds_efficiency", "hpc")])
    assert np.array_equal(other.predict(u).y, engine.predict(u, held).y)
    assert evidence.noise.sigma["T3_K"] == nominal.sigma["T3_K"]
    assert evidence.settings.noise == "estimate"  # what that fit left holds the mismatch too


def test_noise_as_stated_is_taken_at_its_word(engine):
    evidence = build_dataset(engine, [flight(engine)])
    assert evidence.settings.noise == "specified"
    assert evidence.noise.sigma == {"N1_rpm": engine.sensors["N1_rpm"].noise_sigma}
    assert build_dataset(engine, [flight(engine)], MismatchQuery(noise="estimate")).settings.noise == "estimate"


def test_further_drivers_must_be_recorded(fleet):
    evidence = load_case(
        RecordedCase(TURBOFAN, RecordingSource((fleet,)), asked=MismatchQuery(drivers=("valve",)))
    ).evidence
    assert evidence.drivers == ("valve",)
    assert evidence.flights[0].columns["valve"].tolist() == [0.0, 1.0, 0.0]
    with pytest.raises(DataError, match=r"no recording has numbers in a column 'valvee' \(did you mean 'valve'"):
        load_case(RecordedCase(TURBOFAN, RecordingSource((fleet,)), asked=MismatchQuery(drivers=("valvee",))))


def test_gross_errors_are_masked_and_told(tmp_path):
    path = tmp_path / "f.csv"
    path.write_text("\n".join([HEAD, *rows("A", "1"), *rows("A", "1", T3="-9999")]) + "\n", encoding="utf-8")
    loaded = load_case(RecordedCase(TURBOFAN, RecordingSource((str(path),))))
    assert np.isnan(loaded.evidence.flights[0].columns["T3_K"]).sum() == 3
    (left,) = loaded.intake.excluded
    assert left.columns["T3_K"] == {"out of limits": 3} and left.readings["T3_K"] == 6


def test_a_recording_without_any_sensor_is_refused(engine):
    bare = flight(engine)
    bare = replace(bare, columns={c: v for c, v in bare.columns.items() if c != "N1_rpm"})
    with pytest.raises(DataError, match="no reading of any sensor"):
        build_dataset(engine, [bare])
