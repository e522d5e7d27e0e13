"""Effects whose driver is not recorded: where they act, how strongly in every record, and when they switch.

An effect still moves the readings along a known direction when no column shows what it varies with. At a fit without
it, every location is given an amplitude of its own in every record and judged by its marginal likelihood ratio; the
gate for the largest of all of them is drawn from the same geometry with nothing missing. The best locations are then
refitted as two states, on and off, and the better of the two accounts is told: the score at a fit without the effect
makes the shortlist, the refit decides, since a large effect has bent the fit without it.

What the readings cannot say: which of two states is "on". Exchanging them and the sign of the amplitude fits equally
once a constant has been identified; only the sign that physics gives (a bleed takes air) decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.believable import switching
from enginediag_cli.mismatch.fit.freeform import Location, locations, of_effect
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis, Nuisance, nuisance, stack_column
from enginediag_cli.mismatch.fit.neighbours import TIME
from enginediag_cli.mismatch.fit.noise import doubtful_ratio
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.unrecorded.amplitude import Likelihood, Solver, own_error, taken_for
from enginediag_cli.mismatch.unrecorded.finding import Doubtful, HiddenFinding, Limit, Remark, Switch
from enginediag_cli.mismatch.unrecorded.gate import draws_for, largest, likelihoods, threshold
from enginediag_cli.mismatch.unrecorded.refit import Refit, believed_of, bounds_of, location_columns, refit
from enginediag_cli.mismatch.unrecorded.states import first_guesses, two_states
from enginediag_cli.mismatch.unrecorded.whitened_rows import Basis, Direction, basis, direction
from enginediag_cli.physics.registry import effect, term, term_names
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.progress import stage

__all__ = ["HiddenFinding", "Switch", "effects_at", "hidden_amplitudes", "hidden_gate", "null_ratios"]

WITHIN = 3.0
"""LR within which two locations are rivals."""

INSEPARABLE = 5.5
"""Half of the 11 units of χ² from which the right of two places comes first 19 times out of 20."""

SURE = 0.45
"""Distance of a state's probability from one half beyond which the record tells when it changed: 19 to 1."""

REFITTED = 4
"""How many of the best locations are refitted as two states at most: seconds each."""
NEAR, SLACK = 0.6, 15.0
"""How many of the best locations are refitted as two states at most, and how near to the best they must be: LR above
NEAR times the best less SLACK."""


class Scan:
    """Every location's amplitude at a fit that carries no such effect, before any is refitted: `findings`, the
    likeliest first, and the `gate` that they are judged by; look at `significant`."""

    def __init__(self, found: IdentifiedHypothesis, projection: Projection, level: float, rng: np.random.Generator):
        of, places, directions = _geometry(found, projection)
        draws = of.noise(draws_for(len(of.gap)), rng)
        both = likelihoods(of, directions, [of.left[:, :, None], draws], believed_of(found, places))
        self.found, self.of = found, of
        self.gate = _doubted(threshold(largest(both)[1:], level), found, projection)
        self.known = {p.name: (d, f) for p, d, f in zip(places, directions, both, strict=True)}
        self.findings = [_finding(found, of, p, *self.known[p.name], self.gate) for p in places]
        self.findings.sort(key=lambda f: (not f.believable, -f.lr))
        self._refitted: dict[str, HiddenFinding] = {}

    @property
    def largest(self) -> float:
        """LR of the likeliest location; 0 where none is significant."""
        return self.findings[0].lr if self.findings and self.findings[0].significant else 0.0

    def refitted(self, along: Nuisance | None = None, at_most: int = REFITTED) -> list[HiddenFinding]:
        """The findings with up to `at_most` locations not far from the best refitted as two states, with the nuisance
        `along` (default: the evidence's own): these stand first, by their evidence after it and how far the place must
        vary; the others follow by their LR."""
        if not self.largest:
            return self.findings
        found, of, findings = self.found, self.of, self.findings
        chosen = self._chosen(at_most)
        again = [self._with_states(f, along) for f in chosen]
        again.sort(key=lambda f: (not f.believable, -f.worth))
        done = {f.location.name for f in chosen}
        findings = again + [f for f in findings if f.location.name not in done]
        rivals = _rivals(findings, of, self.known)
        parameters = found.evidence.engine.parameters
        if findings[0].is_switch and switching(findings[0].location, parameters):
            # a part that breathes, by as much as maps err, does not come and go like something that is commanded
            rivals = tuple(r for r in rivals if switching(r, parameters))
        return [replace(findings[0], rivals=rivals), *findings[1:]]

    def may_be_commanded(self, along: Nuisance | None = None, at_most: int = REFITTED) -> bool:
        """Whether one of the locations that `refitted` would refit is of something that somebody commands, and of two
        states: where none is, the first of the findings is not either."""
        parameters = self.found.evidence.engine.parameters
        own = [f for f in self._chosen(at_most) if switching(f.location, parameters)]
        return any(self._with_states(f, along).is_switch for f in own)

    def _chosen(self, at_most: int) -> list[HiddenFinding]:
        """What is worth a refit."""
        if not self.largest:
            return []
        enough = max(self.gate, NEAR * self.largest - SLACK)
        return _worth_a_refit([f for f in self.findings if f.lr > enough and f.believable], self.found)[:at_most]

    def _with_states(self, f: HiddenFinding, along: Nuisance | None) -> HiddenFinding:
        name = f.location.name
        if name not in self._refitted:
            along = nuisance(self.found.evidence) if along is None else along
            self._refitted[name] = _with_states(f, self.found, self.of, self.known[name][0], along)
        return self._refitted[name]


@stage("looking for a driver that is not recorded")
def hidden_amplitudes(
    found: IdentifiedHypothesis,
    projection: Projection,
    *,
    level: float = 0.05,
    rng: np.random.Generator,
    along: Nuisance | None = None,
    refitted: int = REFITTED,
) -> list[HiddenFinding]:
    """Every location's amplitude, the likeliest first, at a fit that carries no such effect; look at `significant`.

    `level`: probability that any location is significant when nothing is missing; up to `refitted` locations are
    refitted as two states (`Scan.refitted`). A fit that has not converged gives findings that are not significant and
    say so.
    """
    return Scan(found, projection, level, rng).refitted(along, refitted)


def _worth_a_refit(findings: list[HiddenFinding], found: IdentifiedHypothesis) -> list[HiddenFinding]:
    """Where something that is commanded explains more than a part that breathes, the part is not the place of a
    switch."""
    parameters = found.evidence.engine.parameters
    best = max(
        (f.lr for f in findings if np.isfinite(f.believed) and switching(f.location, parameters)), default=-np.inf
    )
    return [f for f in findings if f.lr >= best or switching(f.location, parameters)]


def hidden_gate(
    found: IdentifiedHypothesis, projection: Projection, *, level: float, rng: np.random.Generator
) -> float:
    """LR that the likeliest of all locations exceeds with probability `level` when nothing is missing."""
    gate = threshold(null_ratios(found, projection, draws_for(len(found.number)), rng), level)
    return _doubted(gate, found, projection)


def _doubted(gate: float, found: IdentifiedHypothesis, projection: Projection) -> float:
    """The gate, higher where noise is estimated from few independent readings."""
    estimated = found.evidence.noise.estimated or found.evidence.settings.noise == "estimate"
    return doubtful_ratio(gate, projection) if estimated else gate


def null_ratios(
    found: IdentifiedHypothesis, projection: Projection, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Largest LR over all locations of `count` draws with nothing missing, (count,)."""
    of, places, directions = _geometry(found, projection)
    return largest(likelihoods(of, directions, [of.noise(count, rng)], believed_of(found, places)))


def effects_at(location: Location, engine: Engine) -> list[Effect]:
    """Listed effects that may be on or off without any column showing it and that act at the location: the location's
    own first, then those that act on the same leaf, station or reading."""
    own = location.through
    reach = set(own.site.targets) if own is not None else {location.parameter}
    if location.belongs_to_sensor:
        reach |= {
            f"reading {c}"
            for c, s in engine.sensors.items()
            if any(p.component == location.component for p in s.parameters())
        }
    found = []
    for name in term_names():
        if term(name).SWITCHES:
            for site in term(name).sites(engine.network):
                if reach & set(site.targets):
                    found.append(effect(engine, name, site.name))
    return sorted(found, key=lambda e: own is None or e.label != own.label)


def finding_at(
    effect: Effect, like: HiddenFinding, found: IdentifiedHypothesis, projection: Projection, along: Nuisance
) -> HiddenFinding:
    """The amplitude and two states of one effect at the same fit, judged by the threshold of another finding."""
    place = of_effect(effect)
    of = basis(projection)
    d = direction(of, location_columns(found, [place])[:, :, 0])
    (f,) = likelihoods(of, [d], [of.left[:, :, None]], believed_of(found, [place]))
    return _with_states(_finding(found, of, place, d, f, like.threshold), found, of, d, along)


def _geometry(found: IdentifiedHypothesis, projection: Projection) -> tuple[Basis, list[Location], list[Direction]]:
    """Rows of the fit, and the locations that its readings answer to with their directions."""
    of, places = basis(projection), locations(found)
    columns = location_columns(found, places)
    directions = [direction(of, columns[:, :, j]) for j in range(len(places))]
    seen = [k for k, d in enumerate(directions) if d.diagonal.any()]
    return of, [places[k] for k in seen], [directions[k] for k in seen]


def _finding(
    found: IdentifiedHypothesis, of: Basis, place: Location, d: Direction, f: Likelihood, gate: float
) -> HiddenFinding:
    a, error, alone = (of.of_records(v) for v in (f.amplitude, f.error, np.sqrt(d.diagonal)))
    engine = found.evidence.engine
    unit = (place.through.parameters()[0] if place.through else engine.parameters[place.parameter]).unit
    remark = None if found.converged else Remark(Limit.BASE_FIT, found.reason)
    return HiddenFinding(
        place,
        unit,
        f.kernel.name,
        float(f.best[0]),
        gate,
        found.number,
        a,
        error,
        np.abs(a) * alone,
        bounds_of(found, place)[1],
        converged=found.converged,
        remark=remark,
        believed=believed_of(found, [place])[0],
    )


def _rivals(
    findings: Sequence[HiddenFinding], of: Basis, known: dict[str, tuple[Direction, Likelihood]]
) -> tuple[Location, ...]:
    """Locations as likely as the first within WITHIN, after the refit where there was one, and those that could mimic
    the first one's amplitude so well, at the same τ and correlation, that the readings' noise decides."""
    first = findings[0]
    d, best = known[first.location.name]
    signal = d.applied(of.of_rows(first.amplitude))
    q = of.rows.shape[2]
    left = signal - (of.rows.reshape(-1, q) @ (of.rows.reshape(-1, q).T @ signal.ravel())).reshape(signal.shape)

    def explained(name: str) -> float:
        d = known[name][0]
        solver = Solver(d, taken_for(d), best.kernel, of.gap, best.signal * own_error(d))
        return 0.5 * float(solver.quadratic(d.gathered(left)[:, None])[0])

    needed = explained(first.location.name) - INSEPARABLE
    found = []
    for f in findings[1:]:
        refitted = np.isfinite(f.gain) and np.isfinite(first.gain)
        behind = first.gain - f.gain if refitted else first.lr - f.lr
        if f.significant and (behind < WITHIN or (behind < 2.0 * INSEPARABLE and explained(f.location.name) > needed)):
            found.append(f.location)
    return tuple(found)


def _with_states(
    f: HiddenFinding, found: IdentifiedHypothesis, of: Basis, d: Direction, along: Nuisance
) -> HiddenFinding:
    """The finding with its two states, refitted."""
    bounds, sign = bounds_of(found, f.location)
    a = of.of_rows(-f.amplitude if sign < 0 else f.amplitude)
    states = two_states(of, d, bounds, first_guesses(a, both_ways=sign == 0))
    new = refit(found, along, f.location, bounds, states)
    if not new.converged:
        return replace(f, remark=Remark(Limit.REFIT, new.found.reason))
    half = NORMAL_95 * new.standard_error
    interval = max(bounds.lower, new.coefficient - half), min(bounds.upper, new.coefficient + half)
    gained = 0.5 * (of.objective - new.objective)  # what bending the rest of the fit has brought
    told = replace(
        f,
        states=new.states.on,
        is_switch=new.states.evidence > new.continuous,
        switch_lr=gained + new.states.evidence,
        continuous_lr=gained + new.continuous,
        switches=_switches(new),
        doubtful=_doubtful(new),
        coefficient=new.coefficient,
        interval=interval,
        remark=_remark(new),
    )
    return told if told.believable else replace(told, remark=Remark(Limit.UNBELIEVED))


def _remark(new: Refit) -> Remark | None:
    if new.standard_error == 0.0:
        return Remark(Limit.AT_BOUND)
    return None if new.states.settled else Remark(Limit.UNSETTLED)


def _doubtful(new: Refit) -> tuple[Doubtful, ...]:
    """Runs of records whose state is not told, of one flight each."""
    unsure = np.abs(new.states.on - 0.5) <= SURE
    recording = new.found.problem.recording
    time = stack_column(new.found.evidence, TIME)[new.found.number]
    edge = np.flatnonzero((unsure[1:] != unsure[:-1]) | (recording[1:] != recording[:-1])) + 1
    ends = [0, *edge.tolist(), len(unsure)]
    return tuple(
        Doubtful(new.found.evidence.flights[recording[a]].label, b - a, float(time[a]), float(time[b - 1]))
        for a, b in pairwise(ends)
        if b > a and unsure[a]
    )


def _switches(new: Refit) -> tuple[Switch, ...]:
    """Changes of state within flights, in time order."""
    on, changed = new.states.on > 0.5, new.states.changed
    recording, number = new.found.problem.recording, new.found.number
    flights = new.found.evidence.flights
    first = np.cumsum([0, *(len(next(iter(f.columns.values()))) for f in flights)])
    at = np.flatnonzero((on[1:] != on[:-1]) & (recording[1:] == recording[:-1])) + 1
    time = stack_column(new.found.evidence, TIME)[number]
    sure = np.abs(new.states.on - 0.5) > SURE
    found = []
    for k in at:
        own = np.flatnonzero((recording == recording[k]) & sure)
        last, next_ = own[own < k], own[own >= k]
        found.append(
            Switch(
                flights[recording[k]].label,
                flights[recording[k]].place(int(number[k] - first[recording[k]])),
                bool(on[k]),
                float(changed[k]),
                float(time[last[-1] if last.size else k - 1]),
                float(time[next_[0] if next_.size else k]),
            )
        )
    return tuple(found)
