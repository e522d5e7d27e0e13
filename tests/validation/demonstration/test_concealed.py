"""The demonstration of missing physics: its parts, and (slow) the whole of it."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from xml.dom import minidom

import pytest

from enginediag_cli.__main__ import main
from enginediag_cli.cli.validation import copy_shipped, run
from enginediag_cli.errors import NoVerdictError
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import term
from enginediag_cli.report.messages import Messages
from enginediag_cli.validation import demonstration_missing as script
from enginediag_cli.validation.demonstration_missing import (
    MissingPhysicsResults,
    closing,
    comparison,
    describe_alarms,
    mistakes,
)

SAMPLES = Path(__file__).parents[3] / "sample_data"
NAME = "reynolds_efficiency@hpc"


def found(**other):
    rows = [{"what": "rms", "of": f"T{k}_K", "unit": "K", "before": 2.0, "after": 1.9 - 0.1 * k} for k in range(5)]
    right = MissingPhysicsResults(
        located=[{"component": "hpc", "location": "hpc.efficiency", "driver": "reynolds_index", "verdict": "effect"}],
        explained={"explanations": [{"name": NAME}]},
        refined={
            "effects": [{"term": "reynolds_efficiency", "at": "hpc", "coefficients": {"exponent": 0.148}}],
            "standard_errors": {"reynolds_efficiency.hpc.exponent": 0.004},
            "chi2_per_reading": {"before": 1.12, "after": 1.01, "of": 900},
            "rows": rows,
        },
        before=[{"verdict": "fault"}, {"verdict": "healthy"}],
        after=[{"verdict": "healthy"}, {"verdict": "no verdict"}],
        true=[{"verdict": "healthy"}],
    )
    return replace(right, **other)


def refined(**other):
    return {**found().refined, **other}


@pytest.fixture
def prepared(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    copy_shipped(script.INGREDIENTS)
    script.prepare()
    return tmp_path


def test_only_the_engine_that_flies_carries_the_effect(prepared):
    truth, given = load_engine(script.TRUTH), load_engine(script.ENGINE)
    assert [e.label for e in truth.effects] == [NAME] and not given.effects
    assert truth.effects[0].values[script.COEFFICIENT] == script.SIZE
    assert truth.inputs == given.inputs and list(truth.sensors) == list(given.sensors)


def test_its_size_lies_within_the_bounds_of_its_coefficient():
    (c,) = (c for c in term(script.TERM).COEFFICIENTS if c.name == script.COEFFICIENT)
    assert c.lower < script.SIZE < c.upper


@pytest.mark.skipif(shutil.which("sed") is None or shutil.which("sh") is None, reason="needs a POSIX shell and sed")
def test_the_shell_commands_shown_prepare_the_same_files(prepared):
    kept = {name: Path(name).read_bytes() for name in (script.TRUTH, script.FLIGHTS)}
    for line in script.preparations():
        subprocess.run(["sh", "-c", line], check=True)
    assert kept == {name: Path(name).read_bytes() for name in kept}


def test_a_step_without_its_result_ends_the_demonstration(prepared):
    assert main(["simulate", script.ENGINE, "--records", "20", "-o", script.RECORDED, "-q"]) == 0
    assert main(["simulate", script.ENGINE, "--records", "20", "--seed", "1", "-o", script.UNSEEN, "-q"]) == 0
    with pytest.raises(NoVerdictError, match="is not written"):
        run(Messages(), script.refine(["reynolds_efficiency@hpc"]))
    assert not Path(script.REFINED).exists()


@pytest.mark.parametrize(
    ("explanations", "effects"),
    [
        (
            [{"name": "humidity@ambient + customer_bleed@hpc", "kinds": ["effect", "effect"]}],
            ["humidity@ambient", "customer_bleed@hpc"],
        ),
        ([{"name": NAME, "kinds": ["effect"]}, {"name": "power_offtake@hp", "kinds": ["effect"]}], [NAME]),
        ([{"name": "hpc.efficiency since record 3", "kinds": ["fault"]}], []),
        ([], []),
    ],
)
def test_refine_is_asked_for_what_explain_put_first(explanations, effects, tmp_path):
    path = tmp_path / "explained.json"
    path.write_text(json.dumps({"explanations": explanations}), encoding="utf-8")
    assert script.named_effects(path) == effects
    assert script.refine(effects).count("--term") == len(effects)


def test_what_is_right_is_no_mistake_and_stands_beside_what_was_concealed():
    assert list(mistakes(found())) == [] and closing(found()).startswith("What was concealed was located")
    told = list(comparison(found()))
    assert f"concealed: {NAME}, exponent 0.15" in told
    assert any("exponent 0.148 (95 % interval 0.140 to 0.156)" in line for line in told)
    assert any(line.split()[-6:] == ["1", "of", "2", "0", "of", "1"] for line in told)
    assert [line.split()[2] for line in told if "RMS" in line] == ["T4's", "T3's", "T2's"]
    assert describe_alarms(found().before, "turbofan.yaml").startswith("turbofan.yaml: 1 of 2 windows")


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (
            {"located": [{"component": "hpt", "location": "hpt.efficiency", "driver": "mach", "verdict": "effect"}]},
            "another place first: hpt.efficiency",
        ),
        ({"explained": {"explanations": [{"name": "power_offtake@hp"}]}}, "did not name what was concealed"),
        (
            {"explained": {"explanations": [{"name": NAME}, {"name": "humidity@ambient"}]}},
            "could not exclude humidity@ambient",
        ),
        (
            {"refined": refined(standard_errors={"reynolds_efficiency.hpc.exponent": 0.0005})},
            "outside its 95 % interval",
        ),
        ({"refined": refined(chi2_per_reading={"before": 1.0, "after": 1.1, "of": 9})}, "do not fit better"),
        (
            {
                "before": [{"verdict": "fault"}] * 5 + [{"verdict": "healthy"}] * 42,
                "after": [{"verdict": "fault"}] * 4 + [{"verdict": "healthy"}] * 43,
            },
            "4 alarms in 47 windows, more than chance at nominal 1 %; the engine that flew, 0 in 1",
        ),
        (
            {"before": [{"verdict": "healthy"}] * 40, "after": [{"verdict": "fault"}] + [{"verdict": "healthy"}] * 39},
            "raises more false alarms",
        ),
    ],
)
def test_everything_missed_or_wrong_is_told(wrong, told):
    bad = found(**wrong)
    (mistake,) = mistakes(bad)
    assert told in mistake and f"! {mistake}" in list(comparison(bad))
    assert closing(bad).startswith("1 thing was missed or wrong")


@pytest.mark.slow
def test_the_concealed_effect_is_found_and_the_same_seed_gives_the_same_bytes(tmp_path, capsys):
    folders = tmp_path / "one", tmp_path / "two"
    told = []
    for folder in folders:
        assert main(["demo", "--missing-physics", "--keep", str(folder), "-q"]) == 0
        told.append(capsys.readouterr().out)
    assert told[0] == told[1] and " ! " not in told[0]
    files = [{path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} for folder in folders]
    assert files[0] == files[1]
    engine = load_engine(folders[0] / script.REFINED)
    assert [e.label for e in engine.effects] == [NAME]
    for name in (script.MAP, script.BEFORE_AFTER):  # the pictures that are kept say the same
        assert words((SAMPLES / name).read_bytes()) == words(files[0][name])


def words(picture: bytes) -> list[str]:
    return [t.firstChild.data for t in minidom.parseString(picture).getElementsByTagName("text")]
