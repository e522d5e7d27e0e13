"""`fleet` and its store, and `forecast`, as functions: the same as the commands, from Python."""

from __future__ import annotations

import json

import pytest
import small_fleet

import enginediag_cli
from enginediag_cli import api
from enginediag_cli.__main__ import main
from enginediag_cli.errors import NoVerdictError, UsageError


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fleet")
    small_fleet.make(folder)
    return folder


def test_fleet_gives_the_document_of_its_command_and_all_of_its_tables(folder, tmp_path):
    fleet_file, store = folder / "fleet.yaml", tmp_path / "kept"
    result = enginediag_cli.fleet(fleet_file, jobs=1, store=store)
    shown = ["fleet", str(fleet_file), "--jobs", "1", "--store", str(store), "-q", "-o", str(tmp_path / "fleet.json")]
    assert main(shown) == (0 if result.judged else 3)
    document = json.loads((tmp_path / "fleet.json").read_text(encoding="utf-8"))
    mine = json.loads(json.dumps(result.to_dict()))
    assert (mine["counts"].pop("fresh"), document["counts"].pop("fresh")) == (4, 0)
    assert mine == document
    assert [row["engine"] for row in result.engines] == [engine["serial"] for engine in document["engines"]]
    assert json.dumps(result.rows) == json.dumps(result.engines)  # what is not known is NaN
    assert {row["engine"] for row in result.flights} <= {"1", "2", "3", "4"}
    assert "4 engines, 4 recordings" in result.summary()
    try:
        assert result.plot()._repr_svg_().startswith("<svg")
    except NoVerdictError:
        assert not any(row["severity"] == row["severity"] for row in result.engines)


def test_a_store_is_looked_into_merged_and_pruned(folder, tmp_path):
    fleet_file = folder / "fleet.yaml"
    one, two = folder / "engine_1.csv", folder / "engine_2.csv"
    for name, recording in (("here", one), ("there", two)):
        api.fleet(fleet_file, recording, jobs=1, store=tmp_path / name)
    merged = api.merge_stores(tmp_path / "here", tmp_path / "there")
    assert (merged[0].copied, merged[0].present) == (1, 0)
    status = api.fleet_status(fleet_file, tmp_path / "here")
    assert [row["state"] for row in status] == ["condensed", "condensed", "new", "new"]
    assert (status.findings, status.judged) == (2, 4)
    assert len(api.prune_store(fleet_file, tmp_path / "here", one, dry_run=True)) == 1
    assert api.fleet_status(fleet_file, tmp_path / "here").findings == 2
    assert len(api.prune_store(fleet_file, tmp_path / "here", one)) == 1
    assert api.fleet_status(fleet_file, tmp_path / "here").findings == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [({"jobs": 2, "scheduler": "x"}, "exclude"), ({"scheduler": "x"}, "--store"), ({"what": "engine"}, "engines")],
)
def test_choices_of_fleet_that_do_not_go_together_are_refused(folder, arguments, words):
    with pytest.raises(UsageError, match=words):
        api.fleet(folder / "fleet.yaml", **arguments)


def test_forecast_gives_the_margin_rows_of_trend(folder):
    """The worn engine of the fleet loses margin: the forecast counts the flights to the limit that is stated."""
    nominal, worn = folder / "nominal.yaml", folder / "engine_2.csv"
    limits = api.MarginOptions(limits_K={small_fleet_temperature(folder): 1500.0}, baseline=3)
    found = api.forecast(nominal, worn, margin=limits)
    assert found.rows == api.trend(nominal, worn, what="margin", margin=limits).rows
    last = found.rows[-1]
    assert last["row"] == "margin"
    assert last["limit_K"] == 1500.0


def small_fleet_temperature(folder):
    """The hottest recorded temperature of the engine's burnt gas."""
    return api.forecast(folder / "nominal.yaml", folder / "engine_1.csv").rows[-1]["column"]


def test_a_fleet_takes_no_recorder_of_its_recordings(folder):
    recorded = api.read_recordings(folder / "engine_1.csv", engine_instance="2")
    with pytest.raises(UsageError, match="fleet file"):
        api.fleet(folder / "fleet.yaml", recorded)
