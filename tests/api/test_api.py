"""The library: the same numbers as the command line, from paths, arrays and results; errors that help."""

from __future__ import annotations

import csv
import doctest
import importlib
import io
import json
import sys

import numpy as np
import pytest

import enginediag_cli
from enginediag_cli import api
from enginediag_cli.__main__ import main
from enginediag_cli.errors import DataError, EngineDiagError, NoVerdictError, UsageError


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A folder with a nominal state of the turbojet, healthy records and a series with a change."""
    folder = tmp_path_factory.mktemp("api")
    fault = folder / "fault.yaml"
    fault.write_text(
        "kind: faults\nfaults:\n  - {name: dirt, description: dirt, assumed: true,\n"
        "     changes: {compressor.efficiency: -0.03}, law: {type: step, onset: 0}}\n",
        encoding="utf-8",
    )
    quiet = ["-q"]
    healthy, changed, nominal = (str(folder / name) for name in ("healthy.csv", "changed.csv", "nominal.yaml"))
    assert main(["simulate", "turbojet.yaml", "--records", "150", "--seed", "1", "-o", healthy, *quiet]) == 0
    assert main(["identify", "turbojet.yaml", healthy, "--no-cross-validation", "-o", nominal, *quiet]) == 0
    made = ["simulate", "turbojet.yaml", "--records", "90", "--seed", "2", "-o", changed, *quiet]
    assert main([*made, "--fault", str(fault)]) == 0
    return folder


def cells(folder, *words):
    """Rows of a command, as its JSON has them."""
    out = folder / "rows.json"
    assert main([*map(str, words), "-q", "-f", "json", "-o", str(out)]) == 0
    return json.loads(out.read_text(encoding="utf-8"))


def test_a_verb_gives_the_rows_of_its_command(flown):
    nominal, changed = flown / "nominal.yaml", flown / "changed.csv"
    window = ["-n", nominal, changed, "--window", "30"]
    assert api.detect(nominal, changed, window=30).to_dict()["rows"] == cells(flown, "detect", *window)
    assert api.isolate(nominal, changed, window=30).to_dict()["rows"] == cells(flown, "isolate", *window)
    assert api.trend(nominal, changed, window=30).to_dict()["rows"] == cells(flown, "trend", *window)


def test_arrays_and_frames_give_what_the_file_gives(flown):
    nominal, changed = flown / "nominal.yaml", flown / "changed.csv"
    plain = api.detect(nominal, changed)
    arrays = api.read_recordings(changed).arrays()
    assert api.detect(nominal, arrays).array("statistic") == pytest.approx(plain.array("statistic"), abs=0, rel=0)
    pyarrow = pytest.importorskip("pyarrow")
    table = pyarrow.table({name: values.tolist() for name, values in arrays.items()})
    assert api.detect(nominal, table).array("statistic") == pytest.approx(plain.array("statistic"), abs=0, rel=0)


def test_statistics_need_no_nominal_and_go_from_verb_to_verb(flown):
    nominal, changed = flown / "nominal.yaml", flown / "changed.csv"
    statistics = api.residual(nominal, changed, sensors=True, window=30)
    found = api.isolate(None, statistics)
    assert {row["parameter"] for row in found} == {"compressor.efficiency"}
    assert found.findings == found.judged == 3


def test_a_result_says_writes_and_draws_what_the_command_does(flown, tmp_path, capsys):
    nominal, changed = flown / "nominal.yaml", flown / "changed.csv"
    result = api.detect(nominal, changed, window=30, detectable=False)
    result.save(tmp_path / "library.csv")
    picture = ["--picture", str(tmp_path / "shell.svg"), "-o", str(tmp_path / "shell.csv")]
    assert main(["detect", "-n", str(nominal), str(changed), "--window", "30", *picture]) == 0
    said = capsys.readouterr().err
    assert result.summary() == said.strip()
    assert (tmp_path / "library.csv").read_bytes() == (tmp_path / "shell.csv").read_bytes()
    assert result.plot()._repr_svg_() == (tmp_path / "shell.svg").read_text(encoding="utf-8")
    assert result._repr_html_().count("<tr>") == 1 + len(result)


def test_a_stream_gives_each_row_once_and_the_same(flown):
    nominal, changed = flown / "nominal.yaml", flown / "changed.csv"
    streamed = api.detect(nominal, changed, window=10, stream=True)
    head = streamed.provenance  # computes the first row, which the stream has all the same
    rows = list(streamed.stream())
    whole = api.detect(nominal, changed, window=10)
    assert rows == whole.rows
    assert head == whole.provenance
    assert list(streamed.stream()) == []


def test_a_frame_has_a_column_for_each_key(flown):
    pytest.importorskip("pyarrow")
    result = api.detect(flown / "nominal.yaml", flown / "changed.csv")
    frame = result.to_frame()
    names = frame.column_names if hasattr(frame, "column_names") else list(frame.columns)
    text = io.StringIO()
    result.save(flown / "detected.csv")
    text.write((flown / "detected.csv").read_text(encoding="utf-8"))
    head = next(csv.reader(line for line in text.getvalue().splitlines() if not line.startswith("#")))
    assert list(names) == head


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda f: api.detect(f / "nominal.yaml", {"mach": [0.1], "altitude_m": [1.0, 2.0]}), DataError, "different"),
        (lambda f: api.detect(f / "nominal.yaml", 3.0), DataError, "no recording"),
        (lambda f: api.detect(f / "nominal.yaml", f / "changed.csv", window="soon"), UsageError, "--window"),
        (lambda f: api.detect(f / "nominal.yaml", f / "changed.csv", windw=3), TypeError, "windw"),
        (lambda f: api.isolate(None, f / "changed.csv", advise=True), UsageError, "--nominal"),
        (lambda f: api.residual(f / "nominal.yaml", f / "changed.csv").plot(), NoVerdictError, "no picture"),
        (lambda f: api.detect(f / "nominal.yaml", f / "changed.csv").array("statistics"), KeyError, "statistic"),
        (lambda f: api.load_engine("turbfan.yaml"), DataError, "turbofan.yaml"),
    ],
)
def test_what_is_wrong_is_an_error_of_its_own(flown, call, error, words):
    with pytest.raises(error, match=words):
        call(flown)


def test_every_public_name_is_there_and_says_what_it_is():
    assert set(api.__all__) <= set(dir(enginediag_cli))
    for name in api.__all__:
        assert (getattr(enginediag_cli, name).__doc__ or "").strip(), name
    with pytest.raises(AttributeError, match="no attribute"):
        _ = enginediag_cli.detekt


@pytest.mark.parametrize("module", ["", *(f".api.{name}" for name in api.MODULES)])
def test_the_examples_of_the_library_run(module):
    assert doctest.testmod(importlib.import_module(f"enginediag_cli{module}")).failed == 0


def test_a_frame_without_pandas_or_pyarrow_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(EngineDiagError, match="pip install"):
        api.list_components().to_frame()


def test_columns_are_numbers_of_the_rows(flown):
    result = api.detect(flown / "nominal.yaml", flown / "changed.csv", window=30)
    assert result.array("statistic").shape == (3,)
    assert np.all(result.array("statistic") > result.array("threshold"))
