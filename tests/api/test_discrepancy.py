"""`locate`, `explain`, `refine` and `forecast` as functions: what the commands write, and what they refuse."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli import api
from enginediag_cli.__main__ import main
from enginediag_cli.errors import DataError, NoVerdictError, UsageError
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv

FLIGHTS, RECORDS = 4, 15
TERM = "reynolds_efficiency@compressor"


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Flights of a turbojet whose compressor loses efficiency at low Reynolds numbers, flights of one that does not,
    and the engine file of the latter."""
    folder = tmp_path_factory.mktemp("discrepancy")
    (folder / "engine.yaml").write_text(Path(api.load_engine("turbojet.yaml").path).read_text(encoding="utf-8"))
    engine = load_engine(folder / "engine.yaml")
    losing = engine.replace_effects([effect(engine, "reynolds_efficiency", "compressor", {"exponent": 0.3})])
    for name, truth in (("flown", losing), ("healthy", engine)):
        rng = np.random.default_rng(1)
        flights = np.repeat(np.arange(FLIGHTS), RECORDS)
        height = rng.uniform(1000.0, 11500.0, len(flights))
        weather = rng.normal(0.0, 8.0, FLIGHTS)[flights]
        columns = {"altitude_m": height, "mach": 0.3 + 0.5 * height / 11500.0, "dT_isa_K": weather}
        columns["Wf_kg_s"] = engine.power_from_fraction(rng.uniform(0.5, 0.95, len(flights)), columns)
        predicted = truth.predict(columns)
        sigma = np.array([engine.sensors[c].noise_sigma for c in predicted.columns])
        readings = predicted.y + sigma * rng.standard_normal(predicted.y.shape)
        columns |= {c: readings[:, k] for k, c in enumerate(predicted.columns)}
        write_csv(folder / f"{name}.csv", [Recording(columns, {"flight": [str(k + 1) for k in flights]})])
    return folder


def written(folder, *words):
    """What a command writes as JSON."""
    out = folder / "written.json"
    assert main([*map(str, words), "-q", "-f", "json", "-o", str(out)]) == 0
    return json.loads(out.read_text(encoding="utf-8"))


STATED = {"noise": "specified", "model_error": 0.003}
OPTIONS = ("--noise", "specified", "--model-error", "0.003")
"""Who states both is believed: nothing is identified first, which is quick."""


def test_locate_gives_the_rows_of_its_command_and_its_picture(flown):
    engine, recorded = flown / "engine.yaml", flown / "flown.csv"
    result = api.locate(engine, recorded, **STATED)
    assert result.to_dict()["rows"] == written(flown, "locate", engine, recorded, *OPTIONS)
    assert result.findings == result.judged == 1
    assert result.verdict == result.rows[0]["verdict"]
    assert result.places[0].location == result.rows[0]["location"]
    assert result.sentences[0] in result.summary()
    assert result.plot()._repr_svg_().startswith("<svg")


def test_explain_gives_the_document_of_its_command(flown, tmp_path):
    engine, recorded = flown / "engine.yaml", flown / "healthy.csv"
    result = api.explain(load_engine(engine), recorded, advice=False, **STATED)
    document = written(flown, "explain", engine, recorded, "--no-advice", *OPTIONS)
    assert json.loads(json.dumps(result.to_dict())) == document
    assert result.sentences == document["sentences"]
    result.save(tmp_path / "explained.json")
    assert json.loads((tmp_path / "explained.json").read_text(encoding="utf-8")) == document
    result.save_curves(tmp_path / "curves.csv")
    assert (tmp_path / "curves.csv").exists()
    assert not result.save_plan(tmp_path / "plan.yaml")
    assert not (tmp_path / "plan.yaml").exists()
    assert "plan.yaml: not written" in result.summary()


def test_refine_writes_an_engine_that_carries_the_effect_where_unseen_flights_gain(flown, tmp_path):
    engine, recorded = flown / "engine.yaml", flown / "flown.csv"
    result = api.refine(engine, recorded, terms=[TERM], holdout_last=1, **STATED)
    assert result.accepted, result.reason
    result.save(tmp_path / "refined.yaml")
    refined = load_engine(tmp_path / "refined.yaml")
    assert [e.label for e in refined.effects] == [e.label for e in result.engine.effects] == [TERM]
    sizes = {row["of"]: (row["before"], row["after"]) for row in result if row["what"] == "chi2 per reading"}
    assert sizes["all"][1] < sizes["all"][0]
    result.save_report(tmp_path / "report.json")
    assert json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["verdict"] == "accepted"
    assert result.plot()._repr_svg_().startswith("<svg")


def test_what_no_unseen_flight_gains_by_is_not_written(flown, tmp_path):
    refined = api.refine(
        flown / "engine.yaml", flown / "flown.csv", terms=["humidity@ambient"], holdout_last=1, **STATED
    )
    assert not refined.accepted
    assert refined.reason in refined.summary()
    with pytest.raises(NoVerdictError, match="not written"):
        refined.save(tmp_path / "refined.yaml")
    assert not (tmp_path / "refined.yaml").exists()


def test_of_few_records_an_amplitude_in_each_says_that_they_are_too_few_for_its_end(flown):
    found = api.locate_per_record(flown / "engine.yaml", flown / "flown.csv", every=10, **STATED)
    assert found.judged == 1
    assert "Too few records" in found.summary()
    assert found.fits[0].location.name == found.rows[0]["location"]
    assert len(found.fits[0].amplitude) <= FLIGHTS * (RECORDS // 10 + 1)


@pytest.mark.parametrize(
    ("verb", "arguments", "words"),
    [
        (api.refine, {}, "--holdout-last"),
        (api.refine, {"holdout_last": 1, "switched": True}, "--term"),
        (api.refine, {"holdout_last": 0}, "--holdout-last"),
        (api.explain, {"without": ["humiditi"]}, "humidity"),
        (api.explain, {"every_plan": True, "advice": False}, "--plan"),
        (api.locate, {"noise": "loud"}, "--noise"),
        (api.locate, {"false_finding": 5.0}, "--false-finding"),
        (api.locate_per_record, {"every": 0}, "--per-record"),
    ],
)
def test_arguments_that_do_not_go_together_are_refused_before_anything_is_read(flown, verb, arguments, words):
    with pytest.raises(UsageError, match=words):
        verb(flown / "engine.yaml", flown / "flown.csv", **arguments)


def test_every_name_of_an_effect_can_be_left_out():
    assert "humidity" in api.effect_names()
    assert len(set(api.effect_names())) == len(api.effect_names())


def test_an_engine_with_effects_that_its_file_does_not_have_is_refused(flown):
    engine = load_engine(flown / "engine.yaml")
    changed = engine.replace_effects([effect(engine, "reynolds_efficiency", "compressor", {"exponent": 0.3})])
    with pytest.raises(DataError, match="does not carry"):
        api.locate(changed, flown / "flown.csv")
