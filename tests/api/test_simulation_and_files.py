"""Simulation, identification and files by the library: the command's bytes, results that other verbs take."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from enginediag_cli import api
from enginediag_cli.__main__ import main
from enginediag_cli.errors import DataError, NoVerdictError, UsageError
from enginediag_cli.faults.catalogue import load_faults

FAULT = """\
kind: faults
faults:
  - {name: dirt, description: dirt, assumed: true, changes: {compressor.efficiency: -0.03}, law: {type: step, onset: 0}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("files")
    (found / "fault.yaml").write_text(FAULT, encoding="utf-8")
    return found


@pytest.fixture(scope="module")
def healthy():
    return api.simulate("turbojet.yaml", records=120, seed=1)


@pytest.fixture(scope="module")
def identified(healthy):
    return api.identify("turbojet.yaml", healthy, cross_validation=False)


def test_a_simulation_writes_the_bytes_of_the_command_and_the_truth(folder, capsys):
    fault = str(folder / "fault.yaml")
    written = ["-o", str(folder / "shell.csv"), "--truth", str(folder / "shell_truth.csv")]
    assert main(["simulate", "turbojet.yaml", "--fault", fault, "--records", "9", "--seed", "3", *written]) == 0
    result = api.simulate("turbojet.yaml", faults=fault, records=9, seed=3)
    assert result.summary() == capsys.readouterr().err.strip()
    result.save(folder / "library.csv", truth=folder / "library_truth.csv")
    for name in ("", "_truth"):
        assert (folder / f"library{name}.csv").read_bytes() == (folder / f"shell{name}.csv").read_bytes()
    streamed = api.simulate("turbojet.yaml", faults=[fault], records=9, seed=3, stream=True)
    streamed.save(folder / "streamed.csv")
    assert (folder / "streamed.csv").read_bytes() == (folder / "shell.csv").read_bytes()
    with pytest.raises(DataError, match="stream"):
        streamed.arrays()


def test_arrays_of_a_simulation_are_those_of_its_file(folder):
    result = api.simulate("turbojet.yaml", faults=load_faults(folder / "fault.yaml"), records=9, seed=3)
    result.save(folder / "arrays.csv")
    read = api.read_recordings(folder / "arrays.csv").arrays()
    arrays = result.arrays()
    for name, values in read.items():
        assert arrays[name].astype(float) == pytest.approx(values, rel=1e-9), name
    assert result.array("T3_K") == pytest.approx(arrays["T3_K"], abs=0, rel=0)
    assert np.all(result.truth["compressor.efficiency"] == 0.97)
    assert len(result) == len(arrays["status"]) == 9
    assert result.columns == tuple(arrays)


def test_conditions_may_be_arrays_and_the_engine_a_loaded_one():
    flown = {"altitude_m": [0.0, 500.0], "mach": [0.0, 0.2], "dT_isa_K": [0.0, 5.0], "Wf_kg_s": [0.3, 0.28]}
    engine = api.load_engine("turbojet.yaml")
    result = api.simulate(engine, conditions=flown, noise="none")
    inputs = {name: np.array(values) for name, values in flown.items()}
    predicted = engine.predict(inputs)
    for j, name in enumerate(predicted.columns):
        assert result.arrays()[name] == pytest.approx(predicted.y[:, j], rel=1e-6)


def test_an_identification_writes_says_and_draws_what_the_command_does(
    identified, healthy, folder, monkeypatch, capsys
):
    monkeypatch.chdir(folder)
    healthy.save("recording.csv")
    out = ["-o", "shell.yaml", "--picture", "shell.svg"]
    assert main(["identify", "turbojet.yaml", "recording.csv", "--no-cross-validation", *out]) == 0
    assert identified.summary().split("\n") == capsys.readouterr().err.removesuffix("\n").split("\n")
    identified.save("library.yaml")
    assert Path("library.yaml").read_bytes() == Path("shell.yaml").read_bytes()
    assert identified.plot().svg == Path("shell.svg").read_text(encoding="utf-8")
    assert (identified.refusal, identified.converged, identified.bounds, identified.far_off) == ("", True, (), ())
    values = {row["name"]: row["value"] for row in identified}
    assert values == dict(identified.nominal.theta0)


def test_an_identification_is_a_nominal_engine_whatever_was_asked_of_it_before(identified, folder):
    series = api.simulate("turbojet.yaml", faults=folder / "fault.yaml", records=60, seed=2)
    identified.save(folder / "nominal.yaml")
    series.save(folder / "recording.csv")
    before = api.detect(identified, series)
    assert [row["verdict"] for row in before] == ["fault"]
    [again] = api.isolate(identified, series, flips="", work_scope="").to_dict()["rows"]
    [from_files] = api.isolate(folder / "nominal.yaml", folder / "recording.csv", flips="", work_scope="").rows
    assert {**again, "source": ""} == {**from_files, "source": ""}


def test_an_identification_without_a_nominal_state_says_why(healthy):
    arrays = healthy.arrays()
    arrays["T3_K"] = arrays["T3_K"] * 1.25
    source = api.read_recordings(arrays, accept_mismatch=True)
    result = api.identify("turbojet.yaml", source, first=30, cross_validation=False)
    assert result.refusal.startswith("no nominal state: ")
    assert result.summary().endswith("error: " + result.refusal)
    assert result.to_dict()["refusal"] == result.refusal
    for needs_one in (result.baseline, lambda: result.save("none.yaml"), lambda: api.detect(result, arrays)):
        with pytest.raises(NoVerdictError, match="no nominal state"):
            needs_one()
    assert not Path("none.yaml").exists()


def test_check_says_of_files_what_the_command_prints(healthy, folder, capsys):
    recording, wrong = folder / "checked.csv", folder / "wrong.yaml"
    healthy.save(recording)
    wrong.write_text("kind: faults\nfault: []\n", encoding="utf-8")
    files = [str(folder / "fault.yaml"), str(recording)]
    good = api.check(files, engine="turbojet.yaml")
    assert main(["check", *files, "--engine", "turbojet.yaml"]) == 0
    assert good.summary() == capsys.readouterr().out.strip()
    assert (good.ok, good.judged, good.findings) == (True, 2, 0)
    bad = api.check([wrong, folder / "nowhere.csv", recording])
    assert (bad.ok, bad.judged, bad.findings) == (False, 1, 2)
    assert (bad[0]["line"], bad[0]["column"]) == (2, 1)
    assert not api.check(folder / "nowhere.csv").ok


def test_a_drafted_recorder_is_what_the_command_writes(folder, capsys):
    (folder / "foreign.csv").write_text("Time,ALT (ft),MACH\n00:00:01,1000,0.3\n00:00:02,1100,0.31\n", encoding="utf-8")
    draft = api.draft_recorder(folder / "foreign.csv", engine="turbojet.yaml")
    assert main(["recorder", str(folder / "foreign.csv"), "--engine", "turbojet.yaml"]) == 0
    printed = capsys.readouterr()
    assert (draft.text, draft.summary()) == (printed.out, printed.err.strip())
    draft.save(folder / "drafted.yaml")
    assert api.check(folder / "drafted.yaml").ok
    assert "Wf_kg_s" in draft.missing


def test_building_blocks_are_listed_and_described():
    assert "reynolds_efficiency" in {row["term"] for row in api.list_effects()}
    effect = api.describe_effect("reynolds_efficiency", "turbofan.yaml")
    assert {row["at"] for row in effect} == {"fan", "booster", "hpc"}
    assert effect.to_dict()["term"] == "reynolds_efficiency"
    assert effect.summary().startswith("reynolds_efficiency: ")
    assert {row["component"] for row in api.list_components()} >= {"compressor", "turbine"}
    assert "key" in api.describe_component("compressor")[0]
    assert any(row["variable"] for row in api.list_law_variables("turbojet.yaml"))


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: api.simulate("turbojet.yaml", noise="gausian"), UsageError, "gaussian"),
        (lambda: api.simulate("turbojet.yaml", records=0), UsageError, "--records"),
        (lambda: api.simulate("turbojet.yaml", flights=2, conditions={"mach": [0.1]}), UsageError, "--conditions"),
        (lambda: api.simulate("turbojet.yaml", faults="faults/hpc_fouling.yaml", records=2), ValueError, "hpc"),
        (lambda: api.identify("turbojet.yaml", {"mach": [0.1]}, holdout=1.5), UsageError, "--holdout"),
        (lambda: api.check("a.csv", nominal="n.yaml", engine="e.yaml"), UsageError, "--nominal"),
        (lambda: api.describe_effect("reynolds_eficiency"), UsageError, "reynolds_efficiency"),
        (lambda: api.describe_component("compresor"), UsageError, "compressor"),
    ],
)
def test_what_is_wrong_is_an_error_of_its_own(call, error, words):
    with pytest.raises(error, match=words):
        call()
