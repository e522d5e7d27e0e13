"""The plan between explanations: its flight tells them apart in as many records as it says."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from refine_flights import ENGINE, engine, evidence, library, write_csv

from enginediag_cli.__main__ import main
from enginediag_cli.cli.discrepancy import explain
from enginediag_cli.cli.model import simulate
from enginediag_cli.engine.term import Coefficient as Declared
from enginediag_cli.engine.term import Effect
from enginediag_cli.isolation.planned_flights import SENSOR, SWEEP
from enginediag_cli.mismatch.explain.answer import Coefficient, Explanation
from enginediag_cli.mismatch.explain.plan import PlannedEvidence, advise_flights_for_explanations, whatever_the_form
from enginediag_cli.mismatch.explain.reach import REACH, near_alternatives
from enginediag_cli.mismatch.explain.rejected import Reason, Rejected
from enginediag_cli.mismatch.fit.attempt import attempt
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, Hypothesis, identify_with, nuisance
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION, Option, effect_option
from enginediag_cli.physics.law import Expression, Law, LawPlace, formula_variables
from enginediag_cli.physics.registry import effect, term_names

RIVALS = ("bearing_loss@hp", "power_offtake@hp")
TRUE = {"bearing_loss.hp.fraction": 0.006}


def recorded(label, inputs, rng):
    """A flight of the engine with friction in a bearing, as its sensors read it."""
    e = engine()
    truth = e.replace_effects([effect(e, *RIVALS[0].split("@"))])
    p = truth.predict(inputs, TRUE)
    assert p.ok.all()
    noise = {c: e.sensors[c].noise_sigma * rng.standard_normal(len(p.y)) for c in p.columns}
    return Flight(label, "", {**inputs, **{c: p.y[:, j] + noise[c] for j, c in enumerate(p.columns)}})


def cruise(rng, n=60):
    """Records about one level, where friction and an off-take of power are much the same."""
    u = {
        "altitude_m": 9000.0 + 100.0 * rng.standard_normal(n),
        "mach": 0.75 + 0.01 * rng.standard_normal(n),
        "dT_isa_K": np.full(n, 5.0 * rng.standard_normal()),
    }
    return {**u, "Wf_kg_s": engine().power_from_fraction(rng.uniform(0.55, 0.85, n), u)}


def explained(case):
    along = nuisance(case)
    base = identify_with(case, NULL_HYPOTHESIS, along)
    found = []
    for label in RIVALS:
        t = attempt([effect_option(library(label)[0])], base, along)
        told = tuple(Coefficient(n, "1", v, s, v - 2 * s, v + 2 * s) for n, (v, s) in t.coefficients.items())
        found.append(Explanation(t.options, told, t.objective, base.problem.sigma.size, 0.5, 0.0, 1.0))
    return base, found


def behind(found):
    """χ² by which the wrong explanation is behind the right one."""
    return found[1].objective - found[0].objective


@pytest.fixture(scope="module")
def ambiguous():
    rng = np.random.default_rng(11)
    case = evidence([recorded(f"flight {k}", cruise(rng), rng) for k in range(3)], model_error=0.0)
    return case, *explained(case)


def test_cruise_alone_does_not_tell_friction_from_an_off_take_but_the_planned_flight_does(ambiguous):
    case, base, found = ambiguous
    assert abs(behind(found)) < 6.0
    advice = advise_flights_for_explanations(base, found)
    assert advice is not None and advice.separates
    flight = advice.best_flight
    best = next(s for s in advice.suggestions if s.flight is flight)
    assert flight is not None and best.records <= 160
    told = 0
    for seed in range(4):
        flown = recorded("planned", flight.inputs(engine(), int(best.records)), np.random.default_rng(seed))
        told += behind(explained(replace(case, flights=(*case.flights, flown)))[1]) > 6.0
    assert told >= 3  # nine times out of ten, it says


def test_more_records_of_the_same_cruise_tell_less_than_the_planned_flight(ambiguous):
    _, base, found = ambiguous
    advice = advise_flights_for_explanations(base, found)
    by = {s.subject or s.kind: s for s in advice.suggestions}
    best = max(s.chance for s in advice.suggestions if s.flight is not None)
    assert by["same"].chance < 0.5 < best


def test_the_floor_is_free_over_the_conditions_of_the_candidates(ambiguous):
    """Map errors where nobody has flown make a plan dearer: with exact maps it takes fewer records."""
    case, base, found = ambiguous
    wrong = replace(case, settings=replace(case.settings, map_accuracy=0.003))
    doubtful = advise_flights_for_explanations(identify_with(wrong, NULL_HYPOTHESIS, nuisance(wrong)), found)
    sure = advise_flights_for_explanations(base, found)
    sweeps = [min(s.records for s in a.suggestions if s.kind == SWEEP) for a in (sure, doubtful)]
    assert sweeps[0] < sweeps[1]


def test_an_explanation_alone_needs_no_plan(ambiguous):
    _, base, found = ambiguous
    assert advise_flights_for_explanations(base, found[:1]) is None


def _law(form: str, variable: str, probability: float) -> Explanation:
    """A law of this form at the HPC's efficiency."""
    sizes = (Declared("a", "1", "size", lower=-1.0, upper=1.0, sigma=0.05, typical=0.01),)
    acts, own = LawPlace("hpc.efficiency", "hpc", "", True), formula_variables(engine().network)[variable]
    law = Law(f"{form}_{variable}", acts, Expression.parse(f"a * ({variable} - 1)"), {variable: own}, sizes)
    found = Effect(law, acts.site, {"a": 0.01})
    return Explanation(
        (Option(FORMULA_OPTION, found.label, "hpc", own.driver, Hypothesis((found,))),),
        (),
        0.0,
        9.0,
        probability,
        0.0,
        1.0,
    )


def test_laws_of_the_same_variables_at_the_same_place_are_one_rival_whatever_their_form(ambiguous):
    step, curve = _law("step", "power", 0.4), _law("smooth", "power", 0.3)
    other, listed = _law("step", "reynolds_index", 0.2), replace(ambiguous[2][0], probability=0.1)
    found = whatever_the_form([step, curve, other, listed])
    assert [x.options for x in found] == [step.options, other.options, listed.options]
    assert [x.probability for x in found] == pytest.approx([0.7, 0.2, 0.1])
    assert advise_flights_for_explanations(ambiguous[1], [step, curve]) is None


def test_candidates_stand_behind_the_flights_without_readings(ambiguous):
    case, _, found = ambiguous
    advice = advise_flights_for_explanations(ambiguous[1], found)
    chosen = [s.flight for s in advice.suggestions if s.flight is not None]
    course = PlannedEvidence(case, chosen)
    further = course.evidence.flights[-1]
    assert len(course.planned) == len(chosen) and course.evidence.records == case.records + len(further)
    assert all(np.isnan(further.columns[c]).all() for c in case.noise.sigma)
    assert {s.kind for s in advice.suggestions} >= {SWEEP, SENSOR}


def test_what_is_a_little_behind_stays_a_rival_of_what_is_told_and_what_stands_alone_has_none(ambiguous):
    case, base, (one, other) = ambiguous
    trial = attempt([effect_option(library("nozzle_discharge@core_nozzle")[0])], base, nuisance(case))

    def answer(explanations, behind):
        return SimpleNamespace(explanations=explanations, rejected={trial.label: Rejected(Reason.WORSE, behind)})

    fitted = {trial.label: trial}
    near = near_alternatives(answer((one, other), 8.0), fitted)
    assert [x.label for x in near] == [*RIVALS, trial.label]
    assert near[2].probability == pytest.approx(one.probability * np.exp(-4.0))
    assert len(near_alternatives(answer((one, other), REACH + 1.0), fitted)) == 2
    assert near_alternatives(answer((one,), 8.0), fitted) == ()


# the command


def run_explain(*arguments):
    """With a library of the two rivals alone, which is quicker."""
    others = [n for n in term_names() if f"{n}@hp" not in RIVALS]
    asked = ["--model-error", "0", "--noise", "specified", *(x for n in others for x in ("--without", n))]
    ended = CliRunner().invoke(explain, [str(ENGINE), *arguments, *asked])
    return ended.exit_code, ended.output


@pytest.mark.slow
def test_the_command_writes_the_flight_that_tells_and_simulate_flies_it(ambiguous, tmp_path):
    case = ambiguous[0]
    recording, planned = tmp_path / "cruise.csv", tmp_path / "next.yaml"
    write_csv(list(case.flights), recording)
    code, said = run_explain(str(recording), "--plan", str(planned))
    assert code == 0 and planned.exists(), said
    assert "To tell " in said and "next.yaml: " in said
    flown = CliRunner().invoke(simulate, [str(ENGINE), "--flight", str(planned), "-o", str(tmp_path / "next.csv")])
    assert flown.exit_code == 0
    text = (tmp_path / "next.csv").read_text(encoding="utf-8")
    assert len([line for line in text.splitlines() if line[:1] != "#"]) == 161


def test_a_plan_is_refused_together_with_no_advice(tmp_path, capsys):
    recording = tmp_path / "x.csv"
    recording.write_text("time_s\n0\n", encoding="utf-8")
    assert main(["explain", str(ENGINE), str(recording), "--plan", str(tmp_path / "next.yaml"), "--no-advice"]) == 2
    assert "--plan asks for what --no-advice leaves out" in capsys.readouterr().err
