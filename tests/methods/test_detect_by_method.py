"""`detect --method`: every method on flights of the turbofan, one of which has lost 2 % of HPC efficiency."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from click.shell_completion import ShellComplete

from enginediag_cli.__main__ import main
from enginediag_cli.cli.diagnosis import detect
from enginediag_cli.identification.nominal import Nominal, SensorNoise, learn_envelope
from enginediag_cli.identification.nominal_file import write_nominal
from enginediag_cli.methods.registry import METHODS
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.source import file_sha256
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv

ENGINE = Path(__file__).parents[2] / "configs" / "turbofan.yaml"
N = 120
LEARNS = [name for name, method in METHODS.items() if method.learns]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """nominal.yaml; healthy.csv, faulty.csv and the flights learn1.csv … learn4.csv to learn from; empty.csv, of which
    the second half has no reading."""
    folder = tmp_path_factory.mktemp("methods")
    engine, rng = load_engine(ENGINE), np.random.default_rng(3)
    sigma = {c: s.noise_sigma for c, s in engine.sensors.items()}
    phase = np.linspace(0, 1, N)
    health = {name: {} for name in ("healthy", "empty", *(f"learn{k}" for k in range(1, 5)))}
    for name, parameters in (health | {"faulty": {"hpc.efficiency": 0.98}}).items():
        columns = {"altitude_m": 9e3 * phase, "mach": 0.3 + 0.5 * phase, "dT_isa_K": np.full(N, 5.0)}
        columns[engine.power_setting] = engine.power_from_fraction(0.95 - 0.3 * phase, columns)
        columns = {c: columns[c] for c in engine.inputs}
        y = engine.predict(columns, parameters).y
        readings = {c: y[:, j] + sigma[c] * rng.standard_normal(N) for j, c in enumerate(sigma)}
        if name == "empty":
            readings = {c: np.where(np.arange(N) < 60, v, np.nan) for c, v in readings.items()}
        write_csv(folder / f"{name}.csv", [Recording({**columns, "time_s": 10.0 * np.arange(N), **readings})])
    noise = tuple(SensorNoise(c, s, 0.0, N, float(N), 0) for c, s in sigma.items())
    parts = (str(ENGINE), file_sha256(ENGINE), engine.inputs, (), np.zeros((0, 0)), noise, np.eye(len(sigma)))
    nominal = Nominal(*parts, (), {}, (), (), (), (), learn_envelope(columns), {}, {})
    write_nominal(nominal, folder / "nominal.yaml")
    return folder


@pytest.fixture
def run(files, capsys):
    """`run(*arguments)`: exit code, rows, stderr of `detect -n nominal.yaml`; a method that learns gets its flights."""

    def call(*arguments, learning=True):
        words = [str(files / a) if str(a).endswith(".csv") else str(a) for a in arguments]
        if learning and any(name in words for name in LEARNS):
            words += [w for k in range(1, 5) for w in ("--healthy", str(files / f"learn{k}.csv"))]
        capsys.readouterr()
        code = main(["detect", "-n", str(files / "nominal.yaml"), *words])
        out, err = capsys.readouterr()
        if "json" in words:
            return code, json.loads(out), err
        return (
            code,
            list(csv.DictReader(io.StringIO("".join(line for line in io.StringIO(out) if not line.startswith("#"))))),
            err,
        )

    return call


@pytest.mark.parametrize("name", METHODS)
def test_every_method_sees_two_per_cent_of_hpc_efficiency_lost_and_calls_a_healthy_flight_healthy(run, name):
    code, rows, _ = run("--method", name, "--window", "60", "healthy.csv", "faulty.csv", "--exit-code")
    assert code == 1
    assert [Path(r["source"]).stem for r in rows] == ["healthy", "healthy", "faulty", "faulty"]
    assert [r["verdict"] for r in rows] == ["healthy", "healthy", "fault", "fault"]
    assert {r["method"] for r in rows} == {name}
    for r in rows:
        for test in METHODS[name].tests:
            assert all(np.isfinite(float(r[f"{test}:{c}"])) for c in ("statistic", "threshold", "p_value"))
        exceeds = any(float(r[f"{t}:statistic"]) > float(r[f"{t}:threshold"]) for t in METHODS[name].tests)
        assert r["alarm"] == ("true" if exceeds else "false")
        assert exceeds or not r["isolated"]


@pytest.mark.parametrize("name", ["posterior", "minmax", "parity_filtered", "local"])
def test_what_is_isolated_is_the_parameter_that_changed(run, name):
    _, rows, _ = run("--method", name, "faulty.csv")
    assert (rows[0]["isolated"], rows[0]["isolated_kind"]) == ("hpc.efficiency", "parameters")
    assert (float(rows[0]["probability"] or "nan") > 0.5) == (name in ("posterior", "local"))


def test_principal_components_name_sensors_not_parameters(run):
    _, rows, _ = run("--method", "pca_corrected", "faulty.csv")
    assert rows[0]["isolated_kind"] == "sensors" and rows[0]["isolated"] in load_engine(ENGINE).sensors


@pytest.mark.parametrize("name", METHODS)
def test_a_window_without_readings_has_no_verdict_and_the_others_keep_theirs(run, name):
    code, rows, _ = run("--method", name, "--window", "40", "empty.csv", "--exit-code", "--false-alarm", "1e-6")
    assert [r["verdict"] for r in rows] == ["healthy", "healthy", "no verdict"]
    assert [r["judged"] for r in rows] == ["40", "20", "0"]
    assert "incomplete" in rows[2]["reason"] and not any(rows[2][f"{t}:statistic"] for t in METHODS[name].tests)
    assert code == 0


@pytest.fixture
def none(files):
    """The records of `empty.csv` that have no reading."""
    lines = (files / "empty.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    start = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    (files / "none.csv").write_text(lines[start] + "".join(lines[start + 61 :]), encoding="utf-8")


def test_nothing_judged_is_no_verdict_and_json_has_nulls(run, none):
    code, rows, _ = run("--method", "parity", "none.csv", "--format", "json", "--exit-code")
    assert code == 3 and rows[0]["alarm"] is None and rows[0]["mean:statistic"] is None


def test_rows_do_not_depend_on_the_windows_that_are_judged_together(run):
    _, alone, _ = run("--method", "extended_kalman", "--window", "50", "faulty.csv")
    _, among, _ = run("--method", "extended_kalman", "--window", "50", "healthy.csv", "faulty.csv")
    for a, b in zip(alone, among[3:], strict=True):
        assert float(a["nis:statistic"]) == pytest.approx(float(b["nis:statistic"]), rel=1e-6)


@pytest.mark.parametrize(
    "arguments, words",
    [
        (("--method", "pca_raw"), "--healthy FILE"),
        (("--method", "paritty"), "did you mean"),
        (("--method", "parity", "--healthy", "learn1.csv"), "learns nothing"),
        (("--healthy", "learn1.csv"), "--method that learns"),
        (("--method", "pca_raw", "--healthy", "faulty.csv"), "learnt from"),
        (("--method", "parity", "--detectable"), "--detectable does not go with"),
        (("--method", "parity", "--follow"), "--follow does not go with"),
        (("--method", "parity", "--model-error", "0.2"), "is not in the range"),
        (("--method", "parity", "--reference", "10"), "--reference does not go with"),
        (("--method", "parity", "--linearise", "nominal"), "no such choice"),
    ],
)
def test_options_that_do_not_go_together_are_usage_errors(run, arguments, words):
    code, rows, err = run(*arguments, "faulty.csv", learning=False)
    assert (code, rows) == (2, []) and words in err


def test_an_accuracy_of_maps_that_were_identified_as_exact_changes_nothing_and_that_is_told(run):
    code, rows, err = run("--method", "parity", "--model-error", "0.003", "faulty.csv")
    assert code == 0 and rows == run("--method", "parity", "faulty.csv")[1]
    assert "--model-error 0.003 changes nothing" in err and "identified with maps taken for exact" in err
    assert "changes nothing" not in run("--method", "parity", "--model-error", "0", "faulty.csv")[2]


def test_too_little_to_learn_from_says_what_is_needed(run, none):
    code, _, err = run("--method", "pca_raw", "--window", "120", "--healthy", "none.csv", "faulty.csv", learning=False)
    assert code == 2 and "nothing to learn from" in err and "incomplete" in err


def test_names_of_methods_complete():
    words = ShellComplete(detect, {}, "detect", "_X").get_completions(["--method"], "pca")
    assert [w.value for w in words] == ["pca_raw", "pca_corrected"]


def test_gross_errors_are_rejected_before_any_method_judges(files, run):
    table = list(csv.reader(io.StringIO((files / "healthy.csv").read_text())))
    rows = [k for k, row in enumerate(table) if row and not row[0].startswith("#")][1:]
    head = table[rows[0] - 1]
    for k, column in ((30, "T45_K"), (77, "T3_K")):
        j = head.index(column)
        table[rows[k]][j] = str(float(table[rows[k]][j]) + 40.0)
    with open(files / "spoilt.csv", "w", newline="") as stream:
        csv.writer(stream).writerows(table)
    code, (row,), err = run("spoilt.csv", "--method", "parity")
    assert (code, row["verdict"]) == (0, "healthy")
    assert "gross error" in err
