"""Schemas of outputs: what is really written fits them, and what was released stays until its version goes up.

python tests/cli/test_output_schemas.py    # releases the present columns: writes output_schemas.json
"""

from __future__ import annotations

import csv
import io
import json
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from enginediag_cli.report.tables import OUTPUTS, Columns, Table, column, output
from enginediag_cli.report.tables.detection import WINDOW

RELEASED = Path(__file__).with_name("output_schemas.json")
TESTS = Path(__file__).parents[1]

TYPES = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "integer": int,
    "number": (int, float),
    "null": type(None),
}


def misfits(value: Any, schema: dict[str, Any], where: str = "") -> Iterator[str]:
    """Where a value does not fit a schema: what of draft-07 the schemas here use."""
    if "anyOf" in schema:
        if all(list(misfits(value, one, where)) for one in schema["anyOf"]):
            yield f"{where}: {value!r} is none of {schema['anyOf']}"
        return
    wanted = schema.get("type", [])
    kinds = [wanted] if isinstance(wanted, str) else wanted
    number_as_boolean = isinstance(value, bool) and "boolean" not in kinds
    if kinds and (number_as_boolean or not any(isinstance(value, TYPES[kind]) for kind in kinds)):
        yield f"{where}: {value!r} is no {wanted}"
        return
    for key in schema.get("required", []) if isinstance(value, dict) else ():
        if key not in value:
            yield f"{where}: no {key}"
    for key, item in value.items() if isinstance(value, dict) else ():
        inside = schema.get("properties", {}).get(key)
        patterns = [s for pattern, s in schema.get("patternProperties", {}).items() if re.search(pattern, key)]
        for one in [inside] if inside is not None else patterns:
            yield from misfits(item, one, f"{where}.{key}")
    for k, item in enumerate(value) if isinstance(value, list) and "items" in schema else ():
        yield from misfits(item, schema["items"], f"{where}[{k}]")


def cell_fits(text: str, kind: str, empty: bool) -> bool:
    if text == "":
        return empty or kind in ("text", "scalar", "texts")  # a text and a list may be empty by themselves
    if kind == "boolean":
        return text in ("true", "false")
    if kind in ("number", "integer"):
        return float(text) == float(text) and (kind == "number" or float(text).is_integer())
    return True


def undeclared(table: Table[Any], names: list[str]) -> list[str]:
    return [name for name in names if table.column(name) is None]


def wrong_cells(table: Table[Any], text: str) -> list[str]:
    """Cells and columns of a CSV that are not as declared."""
    head, *lines = list(csv.reader(line for line in io.StringIO(text) if not line.startswith("#")))
    found = undeclared(table, head)
    known = {name: table.column(name) for name in head}
    found += [
        f"{name}: {cell!r}"
        for line in lines
        for name, cell in zip(head, line, strict=True)
        if (c := known[name]) is not None and not cell_fits(cell, c.kind, not c.required)
    ]
    order = [name for name in table.names if name in head]
    assert [name for name in head if name in order] == order
    assert lines, "no row to look at"
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    sys.path.insert(0, str(TESTS / "mutations"))
    from healthy_files import make

    path = tmp_path_factory.mktemp("outputs")
    make(path, records=60)
    drifting = (path / "flights.csv").read_text().splitlines()
    worn = [line.split(",") for line in (path / "faulty.csv").read_text().splitlines()]
    head = drifting[0].split(",")
    at = [head.index(name) for name in worn[0]]
    for k in range(21, 61):  # the second and third flight of three are those of the faulty engine
        cells = drifting[k].split(",")
        for position, cell in zip(at, worn[k], strict=True):
            cells[position] = cell
        drifting[k] = ",".join(cells)
    (path / "washes.csv").write_text("kind,flight\nwash,4\noverhaul,99\n")
    (path / "series.csv").write_text("\n".join(drifting) + "\n")
    return path


COMMANDS = {
    "detect": "detect -n nominal.yaml flights.csv faulty.csv --detectable",
    "detect/follow": "detect -n nominal.yaml --follow --idle 0 faulty.csv",
    "detect/method": "detect -n nominal.yaml --method incremental faulty.csv",
    "isolate": "isolate -n nominal.yaml flight.csv faulty.csv --advise",
    "isolate/components": "isolate -n nominal.yaml faulty.csv --by component",
    "trend": "trend -n nominal.yaml series.csv --window 10",
    "trend/components": "trend -n nominal.yaml series.csv --window 10 --by component",
    "trend/flights": "trend -n nominal.yaml series.csv --what flights",
    "trend/margin": "trend -n nominal.yaml series.csv --what margin --window 10 --events washes.csv",
    "residual": "residual -n nominal.yaml --sensors flights.csv",
    "residual/records": "residual -n nominal.yaml --what records flights.csv",
    "locate": "locate engine.yaml faulty.csv",
    "locate/per-record": "locate engine.yaml flights.csv --per-record 8",
    "simulate": "simulate engine.yaml --flights 1 --records 5",
    "check": "check -n nominal.yaml flights.csv nominal.yaml",
    "study": "study study.yaml",
    "study/counts": "study study.yaml --show counts",
    "study/reliability": "study study.yaml --show reliability",
}

STUDY = """\
kind: study
engine: engine.yaml
records: 40
mission: {type: sweep, altitude_m: [0, 6000], mach: [0.2, 0.6], cas_kt: [150, 380], power: [0.7, 0.9]}
methods: [{name: posterior, type: posterior}]
reliability: true
cases: [{name: strong, repetitions: 4, changes: {compressor.efficiency: -0.03}}]
"""


TAKE_LONG = ("locate", "locate/per-record", "study", "study/counts", "study/reliability")


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n in TAKE_LONG)) for n in COMMANDS])
def test_what_a_command_writes_fits_its_schema_as_csv_and_as_json(here, run, name):
    Path("study.yaml").write_text(STUDY)
    table = output(name)
    arguments = [*COMMANDS[name].split(), "-q"]
    table_text, object_text = (run(*arguments, "-f", form).stdout for form in ("csv", "json"))
    assert wrong_cells(table, table_text) == []
    found = json.loads(object_text)
    declared = table
    if name.startswith("study"):  # one object, whatever is shown
        declared = output("study")
    else:
        assert sorted({key for row in found for key in undeclared(table, list(row))}) == []
    assert list(misfits(found, declared.schema())) == []
    if table_text.startswith("#") and name != "simulate":
        assert f"# schema: enginediag/{name}/{table.version}\n" in table_text
    if declared.document:
        assert found["schema"] == declared.id


def test_the_lines_of_a_log_fit_its_schema(here, run):
    for arguments in (COMMANDS["detect"], COMMANDS["isolate"], COMMANDS["trend"], "check none.csv", "detect -x"):
        run(*arguments.split(), "--log", "log.jsonl", "-q", "-o", "out.csv")
    lines = [json.loads(line) for line in Path("log.jsonl").read_text().splitlines()]
    assert list(misfits(lines, output("log").schema())) == []
    assert any(line.get("verdict") == "fault" for line in lines)
    assert sum("counts" in line for line in lines) > 0
    ends = [line for line in lines if line.get("event") == "end"]
    assert [line["exit_code"] for line in ends] == [0, 0, 0, 2, 2]
    assert all(not undeclared(output("log"), list(line)) for line in lines)


@pytest.mark.slow
def test_explanations_and_refinements_fit_their_schemas(here, run):
    assert run("demo", "--missing-physics", "--keep", "story", "-q").exit_code == 0
    for name, file in (("explain", "explained.json"), ("refine", "refined.json"), ("locate", "located.json")):
        found = json.loads(Path("story", file).read_text())
        assert list(misfits(found, output(name).schema())) == []
        if output(name).document:
            assert found["schema"] == output(name).id
            assert found["sentences"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "asked"),
    [
        ("prove", ["--no-sizes", "--kind", "null", "--kind", "single", "--truth", "same_model"]),
        ("prove/isolate", ["--question", "isolate", "--truth", "same_model"]),
    ],
)
def test_score_sheets_fit_their_schemas(here, run, name, asked):
    arguments = ["prove", "--trials", "2", "--seed", "3", "-q", *asked, "--trials-output", "trials.jsonl"]
    ended = run(*arguments, "-f", "json")
    assert ended.exit_code == 0, ended.stderr
    found = json.loads(ended.stdout)
    assert list(misfits(found, output(name).schema())) == []
    assert found["schema"] == output(name).id
    assert wrong_cells(output(name), run(*arguments, "--resume", "-f", "csv").stdout) == []


def released() -> dict[str, Any]:
    """What is promised of every output: version, and kind, unit and emptiness of each column."""
    return {
        name: {
            "version": (table := output(name)).version,
            "columns": {cell.pop("name"): cell for cell in table.schema()["csv"]["columns"]},
            "document": {f.name: {"type": f.kind, "nullable": not f.required} for f in table.document},
        }
        for name in OUTPUTS
    }


def broken(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """What a reader of a released output would stumble over, although its version is the same."""
    found = []
    for name, old in before.items():
        if name not in now:
            found.append(f"{name}: the output is gone")
            continue
        new = now[name]
        for part in ("columns", "document"):
            for key, told in old[part].items() if new["version"] == old["version"] else ():
                other = new[part].get(key)
                if other is None:
                    found.append(f"{name}: {part}: {key} is gone")
                    continue
                changed = [what for what in ("type", "unit") if told.get(what) != other.get(what)]
                changed += ["nullable"] if other["nullable"] and not told["nullable"] else []
                changed += ["only_with"] if "only_with" in other and "only_with" not in told else []
                found += [f"{name}: {part}: {key}: {what} changed" for what in changed]
        if new["version"] < old["version"]:
            found.append(f"{name}: the version went down")
        elif new["version"] > old["version"]:
            found.append(f"{name}: version {new['version']} is not released: run this file")
    return found


def test_no_column_that_was_released_goes_or_changes_unless_the_version_goes_up():
    assert broken(json.loads(RELEASED.read_text()), released()) == []


def test_the_rule_sees_what_breaks_a_reader_and_nothing_else():
    old = {"a": {"version": 1, "columns": {}, "document": {}}}
    old["a"]["columns"] = {name: {"type": "number", "unit": "s", "nullable": False} for name in ("t", "u", "v", "w")}
    new = json.loads(json.dumps(old))
    new["a"]["columns"]["more"] = {"type": "text", "unit": "", "nullable": True}
    assert broken(old, new) == []
    del new["a"]["columns"]["t"]
    new["a"]["columns"]["u"]["unit"] = "h"
    new["a"]["columns"]["v"]["type"] = "text"
    new["a"]["columns"]["w"]["nullable"] = True
    assert len(broken(old, new)) == 4
    new["a"]["version"] = 2
    assert broken(old, new) == ["a: version 2 is not released: run this file"]
    assert broken(new, new) == []
    assert broken(old, {}) == ["a: the output is gone"]


@pytest.mark.parametrize("name", list(OUTPUTS))
def test_a_schema_is_complete(run, name):
    schema = json.loads(run("schema", f"output/{name}").stdout)
    table = output(name)
    assert schema["$id"] == f"enginediag/{name}/{table.version}"
    columns = schema["csv"]["columns"]
    assert len({c["name"] for c in columns}) == len(columns)
    assert all(c.help for c in (*table.columns, *table.families, *table.document))
    # a unit that the name of a column says is the unit of the column
    for c in columns:
        ending = c["name"].rpartition("_")[2]
        assert c["unit"] == "s" or ending != "s"


def test_the_columns_of_windows_are_those_that_residuals_have():
    from enginediag_cli.residuals.flat import ORIGIN_COLUMNS, WINDOW_COLUMNS

    assert tuple(c.name for c in WINDOW) == WINDOW_COLUMNS
    assert set(ORIGIN_COLUMNS) <= set(output("residual").names)


OF_NUMBERS: Columns[complex] = Columns()


def test_a_row_has_the_declared_order_and_optional_columns_only_where_they_are_asked_for():
    columns = (OF_NUMBERS("real", "number", "r"), OF_NUMBERS("size", "number", "s", abs, only_with="--size"))
    table = Table("x", 1, "x", columns, ("real",))
    assert table.row(3 + 4j) == {"real": 3.0}
    assert list(table.row(3 + 4j, ["size"]).items()) == [("real", 3.0), ("size", 5.0)]


def test_a_forgotten_value_is_an_error_and_an_absent_part_gives_empty_cells():
    table = Table("x", 1, "x", (column("a", "number", "a"), column("b", "text?", "b")))
    with pytest.raises(KeyError, match="b"):
        table.row({"a": 2.0})
    with pytest.raises(AttributeError):
        Table("x", 1, "x", (OF_NUMBERS("none", "number", "no attribute of a complex number"),)).row(1j)
    part = OF_NUMBERS.part(lambda number: number if number.imag else None, (OF_NUMBERS("imag", "number?", "i"),))
    table = Table("x", 1, "x", part)
    assert table.row(2j) == {"imag": 2.0} and table.row(2 + 0j) == {"imag": None}


def test_families_stand_behind_a_column_or_behind_all():
    columns = tuple(OF_NUMBERS(name, "number", name) for name in ("real", "imag"))
    families = (OF_NUMBERS("size:<norm>", "number", "size"),)
    table = Table("x", 1, "x", columns, families=families, family_cells=lambda number: {"size:2": abs(number)})
    assert list(table.row(1j)) == ["real", "imag", "size:2"]
    assert list(replace(table, families_after="real").row(1j)) == ["real", "size:2", "imag"]


def test_a_terminal_shows_declared_columns_only():
    with pytest.raises(ValueError, match="which are no columns"):
        Table("x", 1, "x", (column("a", "number", "a"),), ("b",))


if __name__ == "__main__":
    told = json.dumps(released(), indent=1)  # a line for each column
    told = re.sub(r"\{([^{}]+)\}", lambda found: "{" + " ".join(found.group(1).split()) + "}", told)
    RELEASED.write_text(told + "\n", encoding="utf-8")
