"""The engine travels in the nominal file, whole and as it was identified, and its own file is no longer needed."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from healthy_files import make

from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.errors import ConfigError
from enginediag_cli.identification.nominal_file import format_nominal, read_nominal, write_nominal
from enginediag_cli.intake.selection import open_baseline
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.source import file_sha256

MAP = "turbine_map.csv"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A turbojet: engine.yaml, nominal.yaml with the engine in it, flights.csv, and a table of a turbine map."""
    path = tmp_path_factory.mktemp("described")
    make(path, records=81)
    rows = ["# PR along, speed down", "Nc_map,PR_map,Wp_map,eff_map"]
    rows += [
        f"{n},{p},{w:.6f},{e:.6f}"
        for n in (0.4, 0.8, 1.2)
        for p in (1.2, 1.8, 2.4, 3.0, 4.0)
        for w, e in [(1.0 - 0.3 / p**2, 0.86 - 0.02 * (n - 1) ** 2)]
    ]
    (path / MAP).write_text("\n".join(rows) + "\n", encoding="utf-8")
    engine = load_engine(path / "engine.yaml")
    described = EngineDescription.from_engine_file(path / "engine.yaml", engine.declared)
    nominal = replace(read_nominal(path / "nominal.yaml"), description=described, engine_path="engine.yaml")
    write_nominal(nominal, path / "nominal.yaml")
    return path


def rows_of(ended):
    return list(csv.DictReader(line for line in io.StringIO(ended.stdout) if not line.startswith("#")))


def test_the_description_is_written_and_read_without_loss(here):
    given = read_nominal("nominal.yaml")
    text = "\ufeffkind: engine\r\n# ü\r\nname: 'x'  \r\n\tend"
    for description in (given.description, EngineDescription("engine.yaml", text, {"a/m.csv": "1, 2 \n\n3"})):
        write_nominal(replace(given, description=description), "again.yaml")
        found = read_nominal("again.yaml")
        assert found.description == description
        assert format_nominal(found) == Path("again.yaml").read_text(encoding="utf-8")


def test_what_identify_writes_holds_the_engine_file_byte_for_byte(here, run):
    ended = run("identify", "engine.yaml", "flights.csv", "--no-cross-validation", "-q", "-o", "made.yaml")
    assert ended.exit_code == 0, ended.stderr
    nominal = read_nominal("made.yaml")
    assert nominal.description.text.encode() == Path("engine.yaml").read_bytes()
    assert nominal.description.sha256 == nominal.engine_sha256 == file_sha256("engine.yaml")


@pytest.mark.parametrize("words", [("detect",), ("isolate", "--nonlinear", "never"), ("residual",), ("trend",)])
def test_an_engine_file_that_is_gone_or_changed_alters_no_answer(here, run, words):
    command = (words[0], "-n", "nominal.yaml", *words[1:], "flights.csv")
    before = run(*command)
    text = Path("engine.yaml").read_text(encoding="utf-8")
    Path("engine.yaml").write_text(text.replace("pressure_ratio: ", "pressure_ratio: 1", 1), encoding="utf-8")
    changed = run(*command)
    told = [line for line in changed.stderr.splitlines() if "has changed since" in line]
    assert len(told) == 1 and "which travels in nominal.yaml, is used" in told[0]
    Path("engine.yaml").unlink()
    gone = run(*command)
    assert "engine.yaml" not in gone.stderr
    for ended in (changed, gone):
        assert (ended.exit_code, rows_of(ended)) == (before.exit_code, rows_of(before))


def test_a_changed_engine_file_is_used_where_that_is_asked_for(here, run):
    with open("engine.yaml", "a", encoding="utf-8") as stream:
        stream.write("# a remark\n")
    baseline = open_baseline("nominal.yaml")
    assert Path(baseline.unused_engine).name == "engine.yaml" and not baseline.changed_engine
    baseline = open_baseline("nominal.yaml", accept_changed_engine=True)
    assert baseline.changed_engine == file_sha256("engine.yaml") and not baseline.unused_engine


def test_an_engine_file_that_is_given_must_be_the_one_identified(here):
    assert not open_baseline("nominal.yaml", "engine.yaml").unused_engine
    with open("engine.yaml", "a", encoding="utf-8") as stream:
        stream.write("# a remark\n")
    with pytest.raises(ConfigError, match="has changed since its nominal state was identified"):
        open_baseline("nominal.yaml", "engine.yaml")


def test_what_is_wrong_with_the_description_is_told_at_its_line_of_the_nominal_file(here):
    lines = Path("nominal.yaml").read_text(encoding="utf-8").splitlines()
    at = next(k for k, line in enumerate(lines) if line.strip() == "- type: compressor" or "type: compressor," in line)
    lines[at] = lines[at].replace("compressor", "comprssor", 1)
    text = "\n".join(line for line in lines if not line.startswith("checksum"))
    Path("nominal.yaml").write_text(text + "\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"nominal\.yaml:{at + 1}:\d+: .*did you mean 'compressor'"):
        open_baseline("nominal.yaml")


def test_map_tables_travel_and_their_faults_are_told_in_the_nominal_file(here, monkeypatch):
    engine = Path("engine.yaml").read_text(encoding="utf-8")
    table = f"table: {{file: {MAP}, design_speed: 0.8, design_pressure_ratio: 2.4}}"
    Path("engine.yaml").write_text(re.sub(r"map: \{choking_exponent: 3.*\}", table, engine), encoding="utf-8")
    built = load_engine("engine.yaml")
    described = EngineDescription.from_engine_file("engine.yaml", built.declared)
    assert described.tables == {MAP: Path(MAP).read_text(encoding="utf-8")}
    Path(MAP).unlink()
    Path("engine.yaml").unlink()
    again = load_engine(described)
    row = {c: np.array([0.0]) for c in built.inputs} | {built.power_setting: np.array([0.3])}
    assert np.array_equal(again.predict(row).y, built.predict(row).y, equal_nan=True)
    with pytest.raises(ConfigError, match=f"the map table {MAP} does not travel"):
        load_engine(replace(described, tables={}))
    nominal = read_nominal("nominal.yaml")
    wrong = {MAP: described.tables[MAP].replace("0.4,1.8", "0.4,x", 1)}
    write_nominal(replace(nominal, description=replace(described, tables=wrong)), "nominal.yaml")
    at = next(k for k, line in enumerate(Path("nominal.yaml").read_text("utf-8").splitlines(), 1) if "0.4,x" in line)
    with pytest.raises(ConfigError, match=rf"nominal\.yaml:{at}: error: a map entry is not a number"):
        open_baseline("nominal.yaml")
