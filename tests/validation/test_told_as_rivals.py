"""What is told as one of several that flights cannot tell apart is not told as being there."""

from __future__ import annotations

import numpy as np

from enginediag_cli.mismatch.explain.answer import IDENTIFIED
from enginediag_cli.validation.explain_trials import FormulaMatch, NamedCause
from enginediag_cli.validation.formula_marks import AnsweredFormula
from enginediag_cli.validation.marks import ExplainAnswer
from enginediag_cli.validation.trial_flights import Cause

STEP, EFFECT, LAW = "sensor.T3.scale", "fouling@hpc", "bump@hpc.efficiency"


def explanation(*causes: str, laws=()):
    return {"causes": [Cause(c).to_json() for c in causes], "laws": list(laws), "probability": 0.5}


def told(*explanations) -> ExplainAnswer:
    return ExplainAnswer.from_json({"status": IDENTIFIED, "explanations": list(explanations), "hidden": []})


def test_what_every_explanation_has_is_told_as_being_there():
    said = told(explanation(STEP, EFFECT), explanation(STEP))
    assert NamedCause(Cause(EFFECT)).is_optional(said) and not NamedCause(Cause(STEP)).is_optional(said)
    assert not NamedCause(Cause(EFFECT)).is_optional(told(explanation(STEP, EFFECT)))


def test_a_law_of_another_form_at_the_same_place_is_the_same_one():
    other = {"law": "wave", "at": "hpc.efficiency"}
    elsewhere = {"law": "bump", "at": "lpt.efficiency"}
    law = NamedCause(Cause(LAW), (), is_law=True)
    first = explanation(STEP, LAW, laws=[{"law": "bump", "at": "hpc.efficiency"}])
    assert not law.is_optional(told(first, explanation(STEP, "wave@hpc.efficiency", laws=[other])))
    assert law.is_optional(told(first, explanation(STEP, "bump@lpt.efficiency", laws=[elsewhere])))


def test_a_law_is_left_open_where_its_variables_are_among_those_told_at_its_place():
    x = np.linspace(0.2, 0.8, 50)
    values = {"mach": x, "ram": 1.0 + 2.0 * x, "power": np.cos(9.0 * x)}
    true = FormulaMatch(["mach"], frozenset({"hpc.efficiency"}), {}, values)

    def law(alike, *along) -> AnsweredFormula:
        return AnsweredFormula(((alike[0], 1.0),), ((along[0], 0.4),), along, tuple(alike), (), 1.0, 1.0)

    power, ram = (("power",),), (("ram",),)
    assert true.is_listed(law(["lpc.efficiency", "hpc.efficiency"], power, ram))
    assert not true.is_listed(law(["hpc.efficiency"], power))
    assert not true.is_listed(law(["lpc.efficiency"], ram))
