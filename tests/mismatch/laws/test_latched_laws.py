"""A valve that jumps with hysteresis is a law of what it follows, with the thresholds that its states have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.intake.selection import RecordingSource
from enginediag_cli.mismatch.explain.answer import FORMULA, HIDDEN_STATE
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.follows import followed
from enginediag_cli.mismatch.explain.unrecorded_search import hidden_search, refit_noise_without_switches
from enginediag_cli.mismatch.fit.load import RecordedCase, load_case
from enginediag_cli.mismatch.laws.scan import known_variables
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import candidate_effects, effect
from enginediag_cli.shipped import shipped

TURBOJET = str(shipped("turbojet.yaml"))
RECORDS, INTERVAL_S, HELD = 200, 20.0, 8
FRACTION, OPEN_BELOW = 0.03, 0.85


def searched(folder: Path, bled: np.ndarray | None, band: float, seed: int) -> Search:
    """Three runs of a turbojet, each held at a power for some records and then at another; it bleeds between two speeds
    when it came from below, or in the records that `bled` (3, N) says."""
    model = load_engine(TURBOJET)
    values = {"fraction": FRACTION, "open_below": OPEN_BELOW, "band": band}
    valve = model.replace_effects([effect(model, "bleed_valve_hysteresis", "compressor", values)])
    at_times = model.replace_effects([effect(model, "customer_bleed", "compressor", {"fraction": FRACTION})])
    rng, files = np.random.default_rng(seed), []
    for run in range(3):
        levels = np.repeat(rng.uniform(0.05, 0.95, RECORDS // HELD), HELD)
        columns = {
            "altitude_m": np.full(RECORDS, rng.uniform(0.0, 6000.0)),
            "mach": np.full(RECORDS, rng.uniform(0.2, 0.6)),
            "dT_isa_K": np.full(RECORDS, rng.normal(0.0, 5.0)),
        }
        columns["Wf_kg_s"] = model.power_from_fraction(np.convolve(levels, np.ones(4) / 4, mode="same"), columns)
        table = {"time_s": INTERVAL_S * np.arange(RECORDS), **columns}
        if bled is None:
            found = valve.predict({**columns, MOMENT: valve.tapes.add(table)})
            read = found.y
        else:
            found = model.predict(columns)
            read = np.where(bled[run][:, None], at_times.predict(columns).y, found.y)
        for j, name in enumerate(found.columns):
            table[name] = read[:, j] + model.sensors[name].noise_sigma * rng.normal(size=RECORDS)
        files.append(str(folder / f"run_{run}.csv"))
        rows = np.column_stack(list(table.values()))
        np.savetxt(files[-1], rows, fmt="%.9g", delimiter=",", header=",".join(table), comments="")
    evidence = load_case(RecordedCase(TURBOJET, RecordingSource(tuple(files))), identified=True).evidence
    known = [e for e in candidate_effects(evidence.engine) if e.term.NAME != "handling_bleed"]
    return Search(refit_noise_without_switches(evidence), known, hidden_search(evidence))


@pytest.mark.slow
def test_a_bleed_valve_that_closes_later_than_it_opens_is_told_with_both_speeds(tmp_path: Path) -> None:
    answer = searched(tmp_path, None, 0.08, 5).run()
    assert answer.status == FORMULA
    (option,) = answer.explanations[0].options
    assert option.label == "rising_corrected_N1@customer_bleed.compressor.fraction"
    told = {c.name.rsplit(".", 1)[-1]: c for c in answer.explanations[0].coefficients}
    assert told["c"].value == pytest.approx(OPEN_BELOW, abs=0.01)
    assert 2.0 * told["h"].value == pytest.approx(0.08, abs=0.01)
    assert answer.law is not None and answer.law.places[0][0].name == "customer_bleed@compressor"


@pytest.mark.slow
def test_air_that_is_bled_at_times_follows_nothing(tmp_path: Path) -> None:
    """The same bleed, switched by a hand that looks at nothing."""
    bled = np.repeat(np.random.default_rng(17).random((3, RECORDS // 20)) < 0.5, 20, axis=1)
    search = searched(tmp_path, bled, 0.0, 7)
    answer = search.run()
    assert answer.status == HIDDEN_STATE and answer.hidden[0].location.name == "customer_bleed@compressor"
    assert followed(answer.hidden[0], search.base.found, known_variables(search.base.found)) == ()
