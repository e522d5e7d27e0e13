"""Variables of a law are those of the fit that carries it, not of the fit that lacks it."""

from __future__ import annotations

import concealed
import numpy as np
import pytest

from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.mismatch.fit.attempt import attempt
from enginediag_cli.mismatch.fit.freeform import locations
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.band import summed
from enginediag_cli.mismatch.laws.carried import Carried, carried
from enginediag_cli.mismatch.laws.scan import formulas, known_variables, scored, seen_at
from enginediag_cli.mismatch.laws.shortlist import proposal
from enginediag_cli.physics.law import Expression, Law, LawPlace, formula_variables

ALONG, READING = "reynolds_index_3", "P3_Pa"


class Searched:
    """A large law of a pressure's reading along a variable that this pressure tells, concealed in flights: a model
    without it is worn. `at`: a fit that carries the law."""

    def __init__(self) -> None:
        engine = concealed.turbofan()
        a = Coefficient("a", "1", "size", lower=-10.0, upper=10.0, sigma=0.05, typical=0.06)
        acts = LawPlace("sensor.P3.scale", "sensor.P3", "1", True)
        law = Law("truth", acts, Expression.parse(f"a * ({ALONG} - 1)"), formula_variables(engine.network), (a,))
        truth = Effect(law, acts.site, {"a": 0.06})
        given = concealed.evidence(concealed.flights((truth,), np.random.default_rng(1400), count=4, records=40))
        found = identify_with(given, NULL_HYPOTHESIS, nuisance(given))
        self.base = HypothesisFit((), found, Projection(found))
        self.known = [k for k in known_variables(found) if k.variable.name in (ALONG, "mach")]
        place = next(p for p in locations(found) if p.name == "sensor.P3")
        own = [f for f in formulas(self.known) if f.what == ("linear", ALONG)]
        option = proposal(scored(found, self.base.projection, [place], own, 0.0)[0], given.engine).option
        self.trial = attempt([option], found, nuisance(given))
        self.effects = self.trial.hypothesis.effects
        self.at: Carried = carried(self.base, self.trial, self.effects, place, self.known)

    def simulated(self) -> np.ndarray:
        """What the law does to the reading in the simulator, as a share of it (N,)."""
        found, engine = self.at.found, self.base.found.evidence.engine
        theta = {n: v for n, v in found.theta.items() if n in engine.parameters}
        with_law, without = (
            e.predict(found.problem.inputs, theta, sensors=(READING,)).y[:, 0] for e in (found.evidence.engine, engine)
        )
        return np.asarray(with_law / without - 1.0)


@pytest.fixture(scope="module")
def searched() -> Searched:
    return Searched()


def test_the_law_that_is_carried_is_what_the_simulator_does(searched: Searched) -> None:
    assert searched.at.f == pytest.approx(searched.simulated(), abs=1e-9)


def test_with_the_variables_of_the_fit_that_lacks_it_it_would_be_another(searched: Searched) -> None:
    lacking = summed(searched.effects, searched.known, searched.trial.values)
    assert np.abs(lacking - searched.simulated()).max() > 1e-4


def test_what_is_recorded_and_what_did_not_move_stays_the_same_object(searched: Searched) -> None:
    at = {k.variable.name: k for k in searched.at.known}
    own = {k.variable.name: k for k in searched.known}
    assert at["mach"] is own["mach"] and at[ALONG] is not own[ALONG]
    assert at[ALONG].group == own[ALONG].group
    assert all(a is b for a, b in zip(seen_at(searched.base.found, searched.known), searched.known, strict=True))


def test_variables_are_what_is_in_the_gas_path_whatever_a_sensor_reads(searched: Searched) -> None:
    found = searched.at.found
    plain = {n: v for n, v in found.theta.items() if not n.startswith("sensor.")}
    gas_path = {n: v for n, v in plain.items() if n in found.evidence.engine.parameters}
    p = found.evidence.engine.predict(found.problem.inputs, gas_path, sensors=(), also=("T3_K", "P3_Pa"))
    index = next(k for k in searched.at.known if k.variable.name == ALONG)
    assert found.theta["sensor.P3.scale"] != 1.0
    assert index.values == pytest.approx(index.variable.values(dict(zip(("T3_K", "P3_Pa"), p.also.T, strict=True))))
