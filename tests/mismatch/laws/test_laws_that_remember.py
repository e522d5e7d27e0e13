"""Laws that remember are found in recordings along time, and their numbers with them."""

from __future__ import annotations

from pathlib import Path

import pytest

from enginediag_cli.__main__ import main
from enginediag_cli.intake.selection import RecordingSource
from enginediag_cli.mismatch.explain.answer import FORMULA, Answer
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.unrecorded_search import hidden_search
from enginediag_cli.mismatch.fit.load import RecordedCase, load_case
from enginediag_cli.physics.registry import candidate_effects

CONFIGS = Path(__file__).parents[3] / "configs"
TURBOFAN = CONFIGS / "turbofan.yaml"


def explained(folder: Path, law: str, seed: int) -> Answer:
    """What is said of five airliner flights, a record a minute, of a turbofan with this law."""
    truth, flights, recorded = folder / "truth.yaml", folder / "flights.yaml", str(folder / "recorded.csv")
    truth.write_text(f"{TURBOFAN.read_text(encoding='utf-8')}\nphysics:\n{law}", encoding="utf-8")
    profile = (CONFIGS / "flights" / "airliner.yaml").read_text(encoding="utf-8")
    flights.write_text(profile.replace("interval_s: 10", "interval_s: 60"), encoding="utf-8")
    flown = ["simulate", str(truth), "--flight", str(flights), "--flights", "5", "--seed", str(seed), "-q"]
    assert main([*flown, "-o", recorded]) == 0
    evidence = load_case(RecordedCase(str(TURBOFAN), RecordingSource((recorded,))), identified=True).evidence
    return Search(evidence, list(candidate_effects(evidence.engine)), hidden_search(evidence)).run()


@pytest.mark.slow
def test_losses_that_come_later_than_they_go_are_a_switch_with_hysteresis(tmp_path: Path) -> None:
    """Off below 0.80 on the way down; on again from 0.90 on, of which flights that never turn round there show that it
    is more than 0.83."""
    answer = explained(
        tmp_path,
        """
  - law: late_valve
    at: hpc.efficiency
    expression: a * (tanh((backlash(corrected_N1, h) - h - c) / w) - tanh((1 - h - c) / w))
    coefficients:
      a: {value: 0.01, absent: 0, prior_sigma: 0.02}
      c: {value: 0.8}
      h: {value: 0.05}
      w: {value: 0.005}
""",
        11,
    )
    assert answer.status == FORMULA
    first = answer.explanations[0]
    assert first.options[0].label == "switch_corrected_N1@hpc.efficiency" and first.probability > 0.9
    told = {c.name.rsplit(".", 1)[-1]: c for c in first.coefficients}
    assert told["c"].value == pytest.approx(0.8, abs=0.01)
    assert told["h"].low > 0.005 and told["h"].low < 0.05 < told["h"].high
    assert told["a"].value == pytest.approx(0.01, abs=0.002)


@pytest.mark.slow
def test_what_follows_the_power_no_faster_than_it_can_is_told_with_its_rate(tmp_path: Path) -> None:
    answer = explained(
        tmp_path,
        """
  - law: slow
    at: hpt.efficiency
    expression: a * (limited(power, s, s) - 1)
    coefficients: {a: {value: 0.07, absent: 0, prior_sigma: 0.05}, s: {value: 1000, unit: s}}
""",
        21,
    )
    assert answer.status == FORMULA
    (option,) = answer.explanations[0].options
    assert option.label.startswith("limited_") and option.label.endswith("@hpt.efficiency")
    told = {c.name.rsplit(".", 1)[-1]: c for c in answer.explanations[0].coefficients}
    assert told["s"].low < 1000.0 < told["s"].high and told["a"].value == pytest.approx(0.07, abs=0.015)
