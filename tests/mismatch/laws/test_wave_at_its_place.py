"""A curve that no form has is told at its own place, not where a form that it resembles happens to fit better."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import pytest

from enginediag_cli.shipped import shipped
from enginediag_cli.trials.blind import explainer, kinds
from enginediag_cli.trials.blind.trial import Plan, run_trial

BLIND = tuple(str(shipped(f"{n}.yaml")) for n in ("turbofan", "turbojet", "power_plant", "turboshaft"))


class Here:
    """The explainer, in this process."""

    def ask(self, question: Mapping[str, Any]) -> Any:
        return json.loads(json.dumps(explainer.answer(question)))


@pytest.mark.slow
def test_a_wave_of_the_power_turbine_s_capacity_is_not_told_of_the_other_turbine() -> None:
    """A swing within 3 % of T4: of single forms a step at the gas generator's turbine is 38 of ln evidence ahead of a
    bump at the truth's place, where smooth curves are 18 ahead of those there."""
    law = kinds.all_of(("law",))
    plan = Plan(BLIND[0], 9535, ("same_model", "map_error"), law, 0.05, BLIND)
    told = run_trial(plan, 19, Here())
    assert told["law"]["place"] == "power_turbine.flow_capacity"
    assert told["law"]["told_places"][0][0] == "power_turbine.flow_capacity" and told["marks"]["law_driver"]
