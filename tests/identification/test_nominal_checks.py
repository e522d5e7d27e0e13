"""A nominal file that was edited, that cannot be, or that is of another engine is refused with its place."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from engine_makers import turbofan
from identification_toy import ToyEngine, fly

from enginediag_cli.error_model.maps import ErrorModel, MapCurves
from enginediag_cli.errors import ConfigError
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.nominal import Estimate
from enginediag_cli.identification.nominal_checks import check_nominal_fits, instance_conflict
from enginediag_cli.identification.nominal_file import (
    fingerprint,
    format_nominal,
    read_nominal,
    refuse_changed_engine,
    write_nominal,
)
from enginediag_cli.recordings.source import file_sha256


@pytest.fixture(scope="module")
def nominal():
    engine, rng = ToyEngine(), np.random.default_rng(0)
    result = identify(engine, [fly(engine, rng, 80, "a")], cross_validation=False)
    return result.nominal("toy.yaml", "00ff", {"engine instance": "left"})


@pytest.fixture
def read(tmp_path):
    """`read(text)`: the nominal of a file that holds this text."""

    def of(text):
        (tmp_path / "nominal.yaml").write_text(text, encoding="utf-8")
        return read_nominal(tmp_path / "nominal.yaml")

    return of


def unsealed(text):
    return re.sub(r"(?m)^checksum:.*\n", "", text)


def test_a_file_as_identify_wrote_it_is_sealed_and_one_without_checksum_is_not(nominal, read):
    text = format_nominal(nominal)
    assert read(text).sealed and not read(unsealed(text)).sealed


def test_an_edited_number_is_refused_and_the_line_that_takes_responsibility_named(nominal, read):
    text = format_nominal(nominal)
    sigma = re.search(r"sigma: ([0-9.]+)", text)[1]
    edited = text.replace(f"sigma: {sigma}", f"sigma: {float(sigma) * 1000!r}", 1)
    with pytest.raises(ConfigError, match=r"nominal\.yaml:\d+:\d+.*edited after identify.*remove the checksum line"):
        read(edited)
    assert not read(unsealed(edited)).sealed


def test_comments_blank_lines_and_line_ends_are_no_edit(nominal, read):
    text = "# kept by the fleet office\n\n" + format_nominal(nominal).replace("\n", "\r\n")
    assert read(text).sealed


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("sigma", "-1.0", "at least 0"),
        ("sigma", "0.0", "sigma of .* must lie between"),
        ("sigma", "1e300", "sigma of .* must lie between"),
        ("rho1", "-1.0", "rho1 of .* must lie between -1 and 1"),
        ("rho1", "1.0", "rho1 of"),
        ("rho1", ".nan", "rho1"),
        ("threshold", "0.0", "threshold must be positive"),
        ("scale", "0.0", "scale must lie between"),
        ("value", "1.0e+300", "value of .* beyond"),
    ],
)
def test_a_value_that_cannot_be_is_refused_with_its_place(nominal, read, key, value, said):
    text = unsealed(format_nominal(nominal))
    edited = re.sub(rf"\b{key}: [^,}}\s]+", f"{key}: {value}", text, count=1)
    assert edited != text
    with pytest.raises(ConfigError, match=rf"nominal\.yaml:\d+:\d+: error: .*{said}"):
        read(edited)


def test_a_covariance_that_is_none_is_refused(nominal, read):
    text = unsealed(format_nominal(nominal))
    p = len(nominal.estimates)
    triangle = [float(x) for x in nominal.covariance[np.tril_indices(p)]]
    torn = list(triangle)
    torn[1] = 2.0 * float(np.sqrt(triangle[0] * triangle[2]))

    def with_covariance(numbers):
        start = text.index("\ncovariance: [")
        return text[:start] + f"\ncovariance: {numbers}\n" + text[text.index("envelope:") :]

    assert read(with_covariance(triangle)).estimates == nominal.estimates
    with pytest.raises(ConfigError, match="not positive semi-definite"):
        read(with_covariance(torn))
    torn = [2.0 * triangle[0], *triangle[1:]]
    with pytest.raises(ConfigError, match=f"covariance of {nominal.estimates[0].name} with itself"):
        read(with_covariance(torn))


def test_estimates_in_another_order_no_longer_fit_their_covariance(nominal, read):
    import yaml

    values = yaml.safe_load(unsealed(format_nominal(nominal)))
    values["estimates"] = dict(reversed(values["estimates"].items()))
    with pytest.raises(ConfigError, match="the square of its standard_error"):
        read(yaml.safe_dump(values, sort_keys=False))


def renamed(engine, old, new):
    """The engine with one parameter and one sensor under another name."""

    def of(names):
        return {(new if name == old else name): value for name, value in names.items()}

    return SimpleNamespace(
        name=engine.name,
        inputs=engine.inputs,
        optional_inputs=engine.optional_inputs,
        parameters=of(engine.parameters),
        sensors=of(dict(engine.sensors)),
    )


@pytest.fixture
def engine():
    toy = ToyEngine()
    return SimpleNamespace(
        name="toy",
        inputs=toy.inputs,
        optional_inputs=toy.optional_inputs,
        parameters=toy.parameters,
        sensors=dict.fromkeys(toy.sensors),
    )


def test_a_nominal_of_another_engine_is_refused_with_place_and_near_match(nominal, engine, tmp_path):
    path = tmp_path / "nominal.yaml"
    write_nominal(nominal, path)
    check_nominal_fits(nominal, engine, path)
    name, column = nominal.estimates[0].name, nominal.sensors[0]
    with pytest.raises(ConfigError, match=rf"nominal\.yaml:\d+:\d+: .*no parameter '{name}'.*did you mean '{name}2'"):
        check_nominal_fits(nominal, renamed(engine, name, f"{name}2"), path)
    with pytest.raises(ConfigError, match=rf"nominal\.yaml:\d+:\d+: .*no sensor '{column}'"):
        check_nominal_fits(nominal, renamed(engine, column, "P9_Pa"), path)


def test_a_nominal_that_knows_fewer_errors_of_maps_than_there_are_is_refused(tmp_path):
    """Such as one that was written when a map had fewer curves."""
    engine, path = turbofan(), tmp_path / "nominal.yaml"
    path.write_text("estimates:\n", encoding="utf-8")
    curves = (MapCurves("hpc", (0.0, 0.0), (1.0, 1.0), (0.0, 0.0, 0.0, 0.0)),)
    found = ErrorModel(0.003, curves, {"hpc.efficiency": 0.003})
    amounts = found.wrap(engine).amounts
    estimates = [Estimate(n, "map_error", "1", 0.0, 0.003, 0.0, 0.003, 0.0, "weak") for n in amounts]
    known = SimpleNamespace(
        error_model=found, estimates=estimates, sensors=(), inputs=(), envelope=SimpleNamespace(inputs=())
    )
    check_nominal_fits(known, engine, path)
    known.estimates = estimates[:-2]
    with pytest.raises(ConfigError, match=f"2 errors of maps were not identified, '{amounts[-2]}'.*identify again"):
        check_nominal_fits(known, engine, path)


def test_a_value_beyond_the_bounds_of_the_engine_is_refused(nominal, engine, tmp_path):
    path = tmp_path / "nominal.yaml"
    first = replace(nominal.estimates[0], value=-50.0)
    wrong = replace(nominal, estimates=(first, *nominal.estimates[1:]))
    write_nominal(wrong, path)
    with pytest.raises(ConfigError, match=f"{first.name} cannot be -50"):
        check_nominal_fits(wrong, engine, path)


def test_a_changed_engine_file_is_refused_unless_it_is_accepted(nominal, tmp_path):
    engine, path = tmp_path / "toy.yaml", tmp_path / "nominal.yaml"
    engine.write_text("kind: engine\n", encoding="utf-8")
    same = replace(nominal, engine_sha256=file_sha256(engine))
    write_nominal(same, path)
    assert refuse_changed_engine(same, engine, nominal_path=path) == ""
    engine.write_text("kind: engine\nname: other\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"nominal\.yaml:\d+:\d+.*has changed.*--accept-changed-engine"):
        refuse_changed_engine(same, engine, nominal_path=path)
    assert refuse_changed_engine(same, engine, accept=True) == file_sha256(engine)


def test_the_other_engine_of_the_aircraft_is_told_from_the_one_identified(nominal):
    assert instance_conflict(nominal, "right") == ("left", "right")
    assert instance_conflict(nominal, "left") is instance_conflict(nominal, "") is None


def test_the_fingerprint_is_that_of_everything_the_nominal_says(nominal, tmp_path):
    write_nominal(nominal, tmp_path / "n.yaml")
    assert fingerprint(read_nominal(tmp_path / "n.yaml")) == fingerprint(nominal)
    assert fingerprint(replace(nominal, engine_sha256="00fe")) != fingerprint(nominal)
