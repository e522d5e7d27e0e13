"""Which listed effect was on: every rival refitted at the states that were found, within its physical bounds.

The search for hidden amplitudes says where something switches and when. What it is, is decided by refitting all that
is identified together with each rival, which is on where the states say so: score to shortlist, refit to decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.drivers import SWITCH
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.attempt import attempt
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.identified import Hypothesis, IdentifiedHypothesis, Nuisance
from enginediag_cli.mismatch.fit.options import Option, effect_option
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding, effects_at, finding_at

TIED = 11.0
"""χ² within which two accounts are told together: the wrong one leads once in twenty times."""
SURELY_WORSE = 22.0
"""χ² by which the wrong one of two accounts leads less than once in a hundred times."""

STATE = "hidden_state"
"""Column with the states: 1 where the effect is on."""


def states_of(finding: HiddenFinding, evidence: Dataset) -> np.ndarray:
    """1 for on, 0 for off, over all records of the evidence (N,); 0 for records that took no part in the fit."""
    assert finding.states is not None
    states = np.zeros(sum(len(next(iter(f.columns.values()))) for f in evidence.flights))
    states[finding.number] = finding.states > 0.5
    return states


def with_state_column(evidence: Dataset, states: np.ndarray) -> Dataset:
    """The evidence with states (N,) over all its records in the column STATE."""
    flights, first = [], 0
    for f in evidence.flights:
        n = len(next(iter(f.columns.values())))
        flights.append(replace(f, columns={**f.columns, STATE: states[first : first + n]}))
        first += n
    return replace(evidence, flights=tuple(flights))


def switched_effect(effect: Effect) -> Option:
    """The effect, on in state 1."""
    return effect_option(replace(effect, switch=STATE))


def switched_parameters(label: str, component: str, targets: Sequence[str], found: IdentifiedHypothesis) -> Option:
    """A change of parameters of the engine in state 1, each between its own bounds; several at once for a rival that
    takes several, such as two sensors."""
    parameters = found.model.parameters
    own = []
    for t in targets:
        p = parameters[t]
        at = found.theta.get(t, p.nominal)
        own.append(Discrepancy(t, STATE, 10.0 * p.prior_sigma, p.lower - at, p.upper - at))
    return Option("effect", label, component, SWITCH, Hypothesis((), tuple(own), {}))


def switched_trials(
    options: Sequence[Option], states: np.ndarray, found: IdentifiedHypothesis, along: Nuisance
) -> list[HypothesisFit]:
    """Each option refitted at the states (N,) over all records of the evidence, the lowest χ² first; those that did
    not converge last. Look at `converged` and `at_bound`."""
    start = replace(found, evidence=with_state_column(found.evidence, states))
    options = [
        replace(o, hypothesis=replace(o.hypothesis, curves={STATE: states} if o.hypothesis.discrepancies else {}))
        for o in options
    ]
    trials = [attempt([o], start, along) for o in options]
    return sorted(trials, key=lambda t: (not t.converged, t.objective))


def effects_that_switch(
    findings: Sequence[HiddenFinding], effects: Sequence[Effect], base: HypothesisFit, along: Nuisance
) -> tuple[HiddenFinding, list[HypothesisFit]] | None:
    """Which listed effect has switched: those that act where some finding has two states, refitted with the states of
    the likeliest finding.

    Returns the best effect's own finding, with its own states, and the trials, the lowest χ² first, that converge and
    stay within their bounds. None where there is none, or where the likeliest place itself, as a parameter of the
    engine that may switch, leaves a χ² that is lower by more than SURELY_WORSE: nearer than that a bare place, which
    fits whatever happens there, and a listed effect are of one class.
    """
    with_states = [f for f in findings if f.is_switch and f.states is not None]
    if not with_states:
        return None
    first, found = with_states[0], base.found
    there = {e.label for f in with_states for e in effects_at(f.location, found.evidence.engine)}
    options = [switched_effect(e) for e in effects if e.label in there]
    if not options:
        return None
    place = first.location
    if place.through is None:
        options.append(switched_parameters(place.name, place.component, (place.parameter,), found))
    trials = [t for t in switched_trials(options, states_of(first, found.evidence), found, along) if t.converged]
    own = min((t.objective for t in trials if not t.hypothesis.effects), default=np.inf)
    listed = [t for t in trials if t.hypothesis.effects and not t.at_bound]
    if not listed or listed[0].objective > own + SURELY_WORSE:
        return None
    best = replace(listed[0].hypothesis.effects[0], switch="")
    lead = finding_at(best, first, found, base.projection, along)
    return (lead, listed) if lead.is_switch and lead.significant else None
