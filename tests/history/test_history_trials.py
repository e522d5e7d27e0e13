"""Stories that trials draw, their marks and their sheet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.validation import history_trials
from enginediag_cli.validation.history_trials import (
    FOULING_WASHED,
    OFF_FROM_START,
    SENSOR_INTERMITTENT,
    Story,
    StoryEvent,
    draw_story,
    history_sheet,
    mark_history,
    rotating_components,
)

CONFIGS = Path(__file__).parents[2] / "configs"
NOISE = {"sensor.T3": 1.5, "sensor.P3": 5000.0, "sensor.N2": 10.0, "sensor.T45": 2.5}
COMPONENTS = ("fan", "hpc", "hpt", "lpt")


@pytest.mark.parametrize("name", ["turbofan", "amt_olympus", "citation_jt15d"])
def test_what_fouls_and_erodes_has_efficiency_and_flow_capacity(name: str) -> None:
    engine = load_engine(str(CONFIGS / f"{name}.yaml"))
    found = rotating_components(engine)
    assert found
    for component in found:
        assert {f"{component}.efficiency", f"{component}.flow_capacity"} <= set(engine.monitored)


def test_stories_have_events_of_different_owners_after_healthy_flights() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        story = draw_story(rng, NOISE, COMPONENTS)
        owners = [event.owner for event in story.events]
        assert len(set(owners)) == len(owners) <= 3 and 20 <= story.flights <= 200
        for event in story.events:
            courses = np.array(list(event.changes.values()))
            assert courses.shape[1] == story.flights
            assert np.all(courses[:, : event.onset] == 0) and np.any(courses[:, event.onset] != 0)
            assert (event.onset == 0) == (event.kind == OFF_FROM_START)
            if event.kind == FOULING_WASHED and event.end > 0:
                course = np.abs(courses[0])
                assert course[event.end] < course[event.end - 1]
            if event.kind == SENSOR_INTERMITTENT:
                assert np.sum(np.diff((courses[0] != 0).astype(int)) > 0) >= 2 or story.flights - event.onset < 4


def answer(owner: str, now: float, **words: Any) -> dict[str, Any]:
    size = [now, now - 0.1, now + 0.1]
    changes = [{"name": f"{owner}.bias", "probability": 1.0, "now": size, "largest": size}]
    event = {
        "probability": 0.99,
        "suspects": {owner: 0.95, "hpc": 0.05},
        "group": [owner],
        "shapes": {"step": 1.0},
        "growing": 0.0,
        "onset_set": [4, 5, 6],
        "end": -1,
        "changes": changes,
    }
    return {"events": [event | words]}


def test_marks_are_those_of_the_true_event() -> None:
    course = np.where(np.arange(20) >= 5, 1.0, 0.0)
    story = Story(20, (StoryEvent("sensor step", "sensor.T3", 5, -1, {"sensor.T3.bias": course}),))
    right = mark_history(story, answer("sensor.T3", 1.05))
    assert {k: right[k] for k in ("named", "shape", "onset", "size", "extra")} == {
        "named": [1],
        "shape": [1],
        "onset": [1],
        "size": [1],
        "extra": [0],
    }
    assert right["stated"] == [[pytest.approx(0.9405), 1]]
    wrong = mark_history(story, answer("sensor.P3", 1.0))
    assert wrong["named"] == [0] and wrong["extra"] == [1] and wrong["stated"][0][1] == 0 and not wrong["size"]
    assert mark_history(story, answer("sensor.T3", 1.0, shapes={"irregular": 1.0}))["shape"] == [1]
    assert mark_history(story, answer("sensor.T3", 1.0, shapes={"ramp": 1.0}))["shape"] == [0]
    assert mark_history(story, answer("sensor.T3", 2.0, onset_set=[9]))["size"] == [0]
    assert mark_history(Story(20), answer("sensor.T3", 1.0))["false_finding"] == [1]
    assert mark_history(Story(20), {})["false_finding"] == [0]


def test_a_sheet_has_the_bins_of_stated_probability() -> None:
    stated = [[0.95, int(k > 0)] for k in range(20)] + [[0.6, 1], [0.6, 0]]
    rows = history_sheet([{"truth": "same_model", "marks": {"stated": stated, "named": [1, 1, 0]}}])
    bins = [row for row in rows if "leading suspect" in row["figure"]]
    assert [(row["hits"], row["count"]) for row in bins] == [(1, 2), (19, 20)]
    gap = rows[-1]
    assert gap["count"] == 22 and gap["rate"] == pytest.approx(0.0) and gap["met"]
    assert rows[0]["rate"] == pytest.approx(2 / 3) and not rows[0]["met"]
    assert len(history_trials.SCORES) == 7
