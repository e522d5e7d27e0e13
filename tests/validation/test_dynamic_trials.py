"""Blind trials of kind dynamic: what is drawn, what shows of it, how it is judged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from enginediag_cli.cli.validation import prove
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import term_names
from enginediag_cli.validation import diagnoser as explainer
from enginediag_cli.validation import kinds
from enginediag_cli.validation import trial_flights as moving_flights
from enginediag_cli.validation.concealed_effects import (
    draw_truth,
    record_trial,
    true_flight_readings,
    write_trial_files,
)
from enginediag_cli.validation.explain_trials import run_trial
from enginediag_cli.validation.score_sheet import sheet
from enginediag_cli.validation.trial_flights import (
    LEAST_CHANGE,
    POWER,
    SIZES,
    Cause,
    causes_hypothesis,
    draw_memories,
    draw_moving_flights,
    drawable_memories,
    power_profile,
)
from enginediag_cli.validation.trials import TrialPlan

CONFIGS = Path(__file__).parents[2] / "configs"
NULL, SINGLE, PAIR = kinds.DYNAMIC_KINDS
ENGINES = ("turbojet", "turboshaft", "naval_gas_generator", "micro_gas_turbine")


@pytest.fixture(scope="module")
def turbojet():
    return load_engine(CONFIGS / "turbojet.yaml")


def drawn(engine, kind, trial=0, seed=5):
    return draw_truth(engine, seed, trial, (kinds.SAME_MODEL,), (kind,))


# what is chosen


def test_kind_dynamic_stands_for_its_null_single_and_pair_trials_and_is_never_drawn_unasked():
    assert kinds.expand_choices((kinds.DYNAMIC,)) == kinds.DYNAMIC_KINDS
    assert not set(kinds.KINDS) & set(kinds.DYNAMIC_KINDS) and not any(map(kinds.is_dynamic, kinds.KINDS))
    assert [kinds.base_kind(k) for k in kinds.DYNAMIC_KINDS] == [kinds.NULL, kinds.SINGLE, kinds.PAIR]


def test_moving_recordings_of_realistic_truths_are_refused():
    ended = CliRunner().invoke(prove, ["--kind", "dynamic", "--truth", "realistic", "--trials", "1"])
    assert ended.exit_code == 2 and "dynamic does not go with --truth realistic" in ended.output


# what is drawn


def test_the_null_trial_conceals_nothing(turbojet):
    s = drawn(turbojet, NULL)
    assert (s.effects, s.values, s.causes, s.change, s.states) == ((), {}, (), 0.0, None)
    state = (rng := np.random.default_rng(1)).bit_generator.state
    assert draw_memories(turbojet, 0, rng) == ((), {}) and rng.bit_generator.state == state


@pytest.mark.parametrize("name", ENGINES)
def test_two_concealed_effects_remember_and_are_of_different_kinds_and_of_a_size_within_their_bounds(name):
    engine = load_engine(CONFIGS / f"{name}.yaml")
    for k in range(20):
        effects, values = draw_memories(engine, 2, np.random.default_rng(k))
        assert len({e.term.NAME for e in effects}) == 2
        for e in effects:
            assert MOMENT in e.term.INPUTS
            for c in e.term.amplitudes():
                value = values[e.parameter_name(c.name)]
                assert c.lower <= value <= c.upper and value != c.absent


def test_every_effect_whose_size_is_stated_is_one_of_the_library():
    assert set(SIZES) <= set(term_names())


def test_an_inertia_is_drawn_only_of_the_rotor_whose_speed_sets_the_power(turbojet):
    assert not any(e.term.NAME == "rotor_inertia" for e in drawable_memories(turbojet))
    shaft = drawable_memories(load_engine(CONFIGS / "turboshaft.yaml"))
    assert [e.label for e in shaft if e.term.NAME == "rotor_inertia"] == ["rotor_inertia@gas_generator"]


def test_power_holds_its_levels_and_steps_between_them_from_one_record_to_the_next():
    time = np.arange(3000.0)
    x = power_profile(time, 1.0, np.random.default_rng(3))
    steps = np.abs(np.diff(x))
    assert POWER[0] <= x.min() and x.max() <= POWER[1]
    assert 0.4 < np.mean(steps == 0.0) < 0.95 and (steps > 0.9 * LEAST_CHANGE / 2.0).any()
    assert (np.abs(np.diff(power_profile(time, 8.0, np.random.default_rng(3)))) <= 1.0 / 8.0 + 1e-12).all()


@pytest.mark.parametrize("name", ENGINES)
def test_moving_flights_lie_inside_the_envelope_and_have_a_solution(name):
    engine = load_engine(CONFIGS / f"{name}.yaml")
    flights, training = draw_moving_flights(engine, np.random.default_rng(0))
    assert 3 <= training <= 5 and len(flights) == training + 2
    for f in flights:
        assert np.all(np.diff(f["time_s"]) == 1.0)
        for column, (low, high) in engine.envelope.items():
            if column in f:
                assert low <= f[column].min() and f[column].max() <= high
    assert all(engine.predict({c: f[c] for c in engine.inputs}).ok.all() for f in flights[:2])


# what shows


def test_what_is_concealed_shows_in_no_column_of_the_recordings(turbojet, tmp_path):
    headers = {}
    for kind in (NULL, SINGLE, PAIR):
        s = drawn(turbojet, kind)
        (folder := tmp_path / kind).mkdir()
        path, files = write_trial_files(folder, turbojet, record_trial(turbojet, s), s.training)
        assert path.read_bytes() == (CONFIGS / "turbojet.yaml").read_bytes()
        texts = [f.read_text(encoding="utf-8") for f in files]
        assert not any(c.name.partition("@")[0] in t for c in s.causes for t in texts)
        headers[kind] = {next(line for line in t.splitlines() if not line.startswith("#")) for t in texts}
    assert headers[NULL] == headers[SINGLE] == headers[PAIR] and len(headers[NULL]) == 1
    assert MOMENT not in next(iter(headers[NULL])).split(",")


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    written = []
    for k in range(2):
        engine = load_engine(CONFIGS / "turbojet.yaml")
        s = drawn(engine, SINGLE, trial=3)
        (folder := tmp_path / str(k)).mkdir()
        _, files = write_trial_files(folder, engine, record_trial(engine, s), s.training)
        written.append([f.read_bytes() for f in files])
    assert written[0] == written[1]


def test_a_rate_limit_that_is_concealed_shows_only_once_the_power_has_moved(turbojet):
    for k in range(100):
        s = drawn(turbojet, SINGLE, trial=k)
        if s.causes[0].name == "fuel_rate_limit@burner":
            break
    without = drawn(turbojet, NULL, trial=k)
    concealed = type(s)(**{**vars(without), "kind": SINGLE, "effects": s.effects, "values": s.values})
    fuel = without.flights[0]["Wf_kg_s"]
    moved = int(np.argmax(np.abs(np.diff(fuel)) > 0.01 * fuel[0]))
    difference = np.abs(
        true_flight_readings(turbojet, concealed, exact_model=True)
        / true_flight_readings(turbojet, without, exact_model=True)
        - 1
    )
    assert moved > 5 and difference[: moved + 1].max() < 1e-9
    assert difference[moved + 1 :].max() > 1e-3


# how it is judged


def test_an_effect_that_is_tried_at_a_size_begins_at_the_coefficients_that_are_known(turbojet):
    rise, fall = (f"fuel_rate_limit.burner.{c}" for c in ("rise", "fall"))
    begun = causes_hypothesis(turbojet, [Cause("fuel_rate_limit@burner")], 10, {rise: 7.0, fall: 9.0}).effects[0]
    assert begun.values == {"rise": 7.0, "fall": 9.0}
    assert (
        causes_hypothesis(turbojet, [Cause("clock_shift@T3")], 10, {"clock_shift.T3.delay": 2.0}).effects[0].values
        == {}
    )


def test_scores_of_moving_trials_are_told_apart_and_only_where_there_are_any():
    still = {"truth": kinds.SAME_MODEL, "kind": kinds.SINGLE, "marks": {"exact": True, "no_verdict": False}}
    moving = {"truth": kinds.SAME_MODEL, "kind": SINGLE, "marks": {"exact": False, "no_verdict": False}}
    assert not any(name.startswith("dynamic_") for name in sheet([still]))
    both = sheet([still, moving])
    assert both["exact"]["rate"] == 1.0 and both["dynamic_exact"]["rate"] == 0.0
    assert both["dynamic_exact"][kinds.SAME_MODEL]["kinds"] == {
        SINGLE: both["dynamic_exact"][kinds.SAME_MODEL]["kinds"][SINGLE]
    }


class InProcess:
    """An explainer that needs no process of its own."""

    def ask(self, question):
        return explainer.answer(question)


@pytest.mark.parametrize(("kind", "trial"), [(NULL, 0), (SINGLE, 5)])
def test_a_small_trial_from_its_seed_to_its_marks(monkeypatch, kind, trial):
    monkeypatch.setattr(moving_flights, "MOVING_RECORDS", (80, 100))
    monkeypatch.setattr(moving_flights, "MOVING_TRAINING", (2, 2))
    path = str(CONFIGS / "micro_gas_turbine.yaml")
    found = run_trial(TrialPlan("explain", (str(path),), 11, (kinds.SAME_MODEL,), (kind,)), trial, InProcess())
    assert found["kind"] == kind and found["engine"] == "micro_gas_turbine" and not found["error"]
    assert found["marks"]["no_verdict"] is False and found["marks"]["false_name"] is False
    if kind == SINGLE:
        assert found["lambda"] > 25.0 and found["marks"]["covered"] is True
