"""nominal.yaml is read and written without loss, and refused with a place when it is damaged."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from identification_toy import ToyEngine, fly

from enginediag_cli.errors import ConfigError
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.nominal_file import (
    engine_file,
    format_nominal,
    read_nominal,
    refuse_changed_engine,
    write_nominal,
)
from enginediag_cli.identification.problem import IdentificationSettings
from enginediag_cli.recordings.source import file_sha256


@pytest.fixture(scope="module")
def nominal():
    engine, rng = ToyEngine(), np.random.default_rng(0)
    settings = IdentificationSettings(
        recording_bias_sigma={"T3_K": 3.0},
        recording_scale_sigma={"Wf_kg_s": 0.02},
        sensors=("T3_K", "Wf_kg_s", "T45_K"),
    )
    flights = [fly(engine, rng, 80, name) for name in ("flight: 1", "no", "1e5")]
    result = identify(engine, flights, settings=settings, held_out=[fly(engine, rng, 30, "later")])
    return result.nominal("configs/toy.yaml", "00ff", {"command": "identify a.csv", "version": "0.1"})


def test_the_round_trip_is_byte_identical(nominal, tmp_path):
    path = tmp_path / "nominal.yaml"
    write_nominal(nominal, path)
    again = read_nominal(path)
    assert format_nominal(again) == path.read_text(encoding="utf-8")


def test_the_round_trip_keeps_every_number_exactly(nominal, tmp_path):
    path = tmp_path / "nominal.yaml"
    write_nominal(nominal, path)
    again = read_nominal(path)
    assert again.estimates == nominal.estimates
    assert again.noise == nominal.noise
    assert again.unidentified == nominal.unidentified
    assert (again.in_sample, again.cross_validated, again.held_out) == (
        nominal.in_sample,
        nominal.cross_validated,
        nominal.held_out,
    )
    assert again.recording_offsets == nominal.recording_offsets
    assert np.array_equal(again.covariance, nominal.covariance)
    assert np.array_equal(again.noise_correlation, nominal.noise_correlation)
    assert np.array_equal(again.envelope.points, nominal.envelope.points)
    assert again.envelope.threshold == nominal.envelope.threshold
    assert (again.theta0, again.sigma, again.rho1) == (nominal.theta0, nominal.sigma, nominal.rho1)


def test_a_file_that_does_not_say_how_well_noise_is_known_is_read_as_certain(nominal, tmp_path):
    keys = ("sigma_from", "degrees", "rho1_error", "rho1_common", "kurtosis")
    values = yaml.safe_load(format_nominal(nominal))
    for sensor in values["noise"].values():
        for key in keys:
            del sensor[key]
    values["recording_offsets"] = []  # their labels need quotes that a plain dump does not give
    path = tmp_path / "nominal.yaml"
    del values["checksum"]
    path.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    for noise in read_nominal(path).noise:
        assert tuple(getattr(noise, key) for key in keys) == ("stated", 0.0, 0.0, 0.0, 0.0)


def test_the_file_opens_with_a_description_and_its_kind(nominal):
    lines = format_nominal(nominal).splitlines()
    assert lines[0].startswith("# ")
    assert "kind: nominal" in lines


def test_a_damaged_file_is_refused_with_its_place(nominal, tmp_path):
    path = tmp_path / "nominal.yaml"
    path.write_text(format_nominal(nominal).replace("threshold:", "treshold:"), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"nominal\.yaml:\d+:\d+.*treshold"):
        read_nominal(path)


def test_a_covariance_of_the_wrong_size_is_refused(nominal, tmp_path):
    path = tmp_path / "nominal.yaml"
    text = format_nominal(nominal)
    path.write_text(text.replace("covariance: [", "covariance: [1.0, ", 1), encoding="utf-8")
    with pytest.raises(ConfigError, match="16 numbers, and 15 are needed for 5 estimates"):
        read_nominal(path)


def test_a_changed_engine_file_is_noticed(nominal, tmp_path):
    from dataclasses import replace

    engine = tmp_path / "configs" / "toy.yaml"
    engine.parent.mkdir()
    engine.write_text("kind: engine\n", encoding="utf-8")
    path = tmp_path / "nominal.yaml"
    now = replace(nominal, engine_sha256=file_sha256(engine))
    assert engine_file(now, path) == engine
    refuse_changed_engine(now, engine)
    engine.write_text("kind: engine\nname: other\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="has changed since its nominal state was identified"):
        refuse_changed_engine(now, engine)
    refuse_changed_engine(now, engine, accept=True)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(nominal, tmp_path, monkeypatch):
    path = tmp_path / "nominal.yaml"
    path.write_text("old", encoding="utf-8")

    def broken(source, target):
        raise OSError("disk full")

    monkeypatch.setattr("os.replace", broken)
    with pytest.raises(OSError, match="disk full"):
        write_nominal(nominal, path)
    assert [p.name for p in tmp_path.iterdir()] == ["nominal.yaml"]
    assert path.read_text(encoding="utf-8") == "old"


def test_the_covariance_of_many_estimates_is_packed_without_loss_and_damage_to_it_has_its_place(
    nominal, tmp_path, monkeypatch
):
    monkeypatch.setattr("enginediag_cli.identification.nominal_file.LISTED", 2)
    path = tmp_path / "nominal.yaml"
    write_nominal(nominal, path)
    text = path.read_text(encoding="utf-8")
    assert "\ncovariance:" not in text
    again = read_nominal(path)
    assert again.covariance.tobytes() == nominal.covariance.tobytes()
    assert format_nominal(again) == text
    start = text.index("\ncovariance_packed: |\n") + len("\ncovariance_packed: |\n  ")
    line = text[:start].count("\n")
    for damaged, told in ((text[:start] + "%" + text[start + 1 :], "not base64"), (_short(text, start), "bytes")):
        path.write_text(damaged, encoding="utf-8")
        with pytest.raises(ConfigError, match=rf"nominal\.yaml:{line}:\d+: error: covariance_packed cannot be.*{told}"):
            read_nominal(path)


def _short(text, start):
    """The text without four characters of what is packed."""
    return text[:start] + text[start + 4 :]
