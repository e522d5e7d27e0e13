"""What is acknowledged of an engine is not raised again unless it grows: `fleet acknowledge`."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
import small_fleet

from enginediag_cli.__main__ import main
from enginediag_cli.errors import DataError
from enginediag_cli.fleets.findings import (
    CHANGED,
    AcknowledgedChange,
    Acknowledgement,
    EngineFinding,
    HealthRow,
    IntervalEstimate,
    acknowledge_finding,
)
from enginediag_cli.fleets.models import merge_acknowledgements
from enginediag_cli.fleets.store import FleetStore


def row(parameter: str, value: float, half: float = 0.1) -> HealthRow:
    change = IntervalEstimate(value, value - half, value + half)
    return HealthRow(parameter, parameter, parameter, "1", change, "step", 0.99, onset=4)


def finding(*rows: HealthRow) -> EngineFinding:
    return EngineFinding("7", "", 20, 200, CHANGED, "", probability=0.99, discovery=True, health=rows)


@pytest.mark.parametrize(
    ("before", "now", "grew"),
    [
        (-1.0, -1.05, False),
        (-1.0, -1.11, True),
        (-1.0, -0.2, False),
        (-1.0, 0.5, True),
        (1.0, 1.2, True),
        (1.0, 0.9, False),
    ],
)
def test_a_change_has_grown_beyond_the_far_end_of_its_interval_or_when_it_is_of_the_other_sign(before, now, grew):
    known = AcknowledgedChange("a", row("a", before).change, "1")
    assert known.grew(row("a", now)) is grew


def test_what_is_acknowledged_settles_an_engine_until_something_grows_or_is_new():
    then = acknowledge_finding(finding(row("a", -1.0), row("b", 2.0)), "2026-03-14", "wash planned")
    same = finding(row("a", -1.02), row("b", 2.0)).compare_acknowledged(then)
    assert same.is_settled and not same.discovery and same.verdict == CHANGED
    grown = finding(row("a", -1.4), row("b", 2.0), row("c", 1.0)).compare_acknowledged(then)
    assert set(grown.acknowledged.grown) == {"a", "c"} and grown.discovery
    part = acknowledge_finding(finding(row("a", -1.0), row("b", 2.0)), "2026-03-14", parameters=["b"])
    assert finding(row("a", -1.0), row("b", 2.0)).compare_acknowledged(part).acknowledged.grown == ("a",)
    with pytest.raises(DataError, match="c has not changed"):
        acknowledge_finding(finding(row("a", -1.0)), "2026-03-14", parameters=["c"])
    with pytest.raises(DataError, match="no change to acknowledge"):
        acknowledge_finding(finding(), "2026-03-14")


def test_a_store_gives_back_what_it_keeps_and_of_two_stores_the_later(tmp_path):
    made = acknowledge_finding(finding(row("a", -1.0)), "2026-03-14", "known")
    one, other = FleetStore(tmp_path / "one"), FleetStore(tmp_path / "other")
    assert one.acknowledgements() == {}
    one.keep_acknowledgements({"7": made})
    assert one.acknowledgements() == {"7": made}
    other.keep_acknowledgements({"7": replace(made, date="2026-04-01"), "8": replace(made, serial="8")})
    merge_acknowledgements(one, other)
    assert {s: x.date for s, x in one.acknowledgements().items()} == {"7": "2026-04-01", "8": "2026-03-14"}
    (tmp_path / "one" / "acknowledged.json").write_text("{}", encoding="utf-8")
    with pytest.raises(DataError, match=r"acknowledged\.json"):
        one.acknowledgements()
    assert isinstance(made, Acknowledgement)


def call(*arguments) -> int:
    return int(main([str(a) for a in arguments]) or 0)


def judged(fleet, store, out, *arguments) -> dict:
    assert call("fleet", fleet, "--store", store, "--jobs", 1, "-q", "-o", out, *arguments) == 0
    return json.loads(out.read_text(encoding="utf-8"))


def test_a_worn_engine_is_flagged_acknowledged_not_raised_again_and_raised_when_it_has_worn_further(tmp_path, capfd):
    fleet, store, out = small_fleet.make(tmp_path), tmp_path / "kept", tmp_path / "fleet.json"
    worn = tmp_path / "engine_2.csv"
    whole = worn.read_text(encoding="utf-8")
    lines = whole.splitlines(keepends=True)
    head = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    worn.write_text("".join(lines[: head + 1 + 6 * small_fleet.RECORDS]), encoding="utf-8")  # six of eight flights
    assert judged(fleet, store, out)["discoveries"]["engines"] == ["2"]
    known = ["fleet", "acknowledge", fleet, "--store", store, "--jobs", 1]
    assert call(*known, "--engine", "1") != 0
    assert "no change to acknowledge" in capfd.readouterr().err
    assert call(*known, "--engine", "9") != 0
    assert "no engine is called '9'" in capfd.readouterr().err
    assert call(*known, "--engine", "2", "--note", "wash planned") == 0
    assert "engine 2: acknowledged" in capfd.readouterr().err
    found = judged(fleet, store, out)
    mine = next(engine for engine in found["engines"] if engine["serial"] == "2")
    assert found["discoveries"]["engines"] == [] and mine["verdict"] == "changed" and not mine["discovery"]
    then = mine["acknowledged"]
    assert then["note"] == "wash planned" and then["flights"] == 6 and then["grown"] == [] and then["date"]
    assert then["changes"][0]["change"]["low"] < then["changes"][0]["change"]["value"]
    assert call("fleet", fleet, "--store", store, "--jobs", 1, "--exit-code", "-o", tmp_path / "rows.csv") == 0
    assert "not raised again unless it grows" in capfd.readouterr().err
    worn.write_text(whole, encoding="utf-8")
    found = judged(fleet, store, out)
    mine = next(engine for engine in found["engines"] if engine["serial"] == "2")
    assert found["discoveries"]["engines"] == ["2"] and mine["acknowledged"]["grown"]
    assert call(*known, "--engine", "2", "--withdraw") == 0
    assert FleetStore(store).acknowledgements() == {}
