"""The times of a hidden switch, narrowed by the records between steady ones.

What is fitted rests on steady records alone. Between two of them the recording goes on; its records are compared with
the model as it was fitted, with the effect and without, and say when the state changed (`change_time`). Nothing is
fitted to them: what is told of them is told of the time alone.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis
from enginediag_cli.mismatch.fit.neighbours import TIME
from enginediag_cli.mismatch.unrecorded.change_time import Errors, Stretch, interval, measured
from enginediag_cli.mismatch.unrecorded.finding import HiddenFinding, Switch
from enginediag_cli.mismatch.unrecorded.hidden import SURE
from enginediag_cli.mismatch.unrecorded.switched import STATE
from enginediag_cli.progress import stage

MOST_STRETCHES = 40
"""Stretches of a known state that are compared with the model, evenly chosen: some 2000 points of the engine."""

MOST_LENGTH = 2.0
"""Of them, over the longest in which something changes: longer ones are another kind of flying."""

NEAREST = 20
"""Stretches by which a change is judged, those in which the engine moves most nearly as much: 80 changes are put into
them."""

GROUPS = 6
"""Of changes that are judged by the same stretches, at most: 0.1 s each."""

AS_MUCH, LEAST_AS_MUCH = 0.7, 3
"""Share of how far the engine moves, from which it counts as moved as much, and known stretches that must be so."""

LEFT_OUT = 1.5
"""Usual steps between two steady records from which some between them were left out."""

NOTHING_LEARNT = 0.9
"""Share of the interval between steady records from which nothing has been learnt: 0.95 of it is what no reading at all
would leave."""

LEAST_RECORDS = 4
"""Of a stretch, with its ends: fewer tell no time."""

Raw = Mapping[tuple[str, str], Mapping[str, np.ndarray]]
"""All records of a flight, steady or not, as columns, by the flight's label and engine."""


@dataclass(frozen=True)
class _Span:
    """Two steady records of flight `k` whose states are told, none between whose state is, their times and states, and
    half the usual step; `whole`: no steady record at all lies between."""

    k: int
    begin_s: float
    end_s: float
    before: float
    after: float
    half_s: float
    whole: bool

    @property
    def length(self) -> float:
        return self.end_s - self.begin_s

    @property
    def is_known(self) -> bool:
        """Whether the state is the same throughout."""
        return self.whole and self.before == self.after


@stage("looking for the times of the changes")
def timed(finding: HiddenFinding, refitted: IdentifiedHypothesis, evidence: Dataset, raw: Raw) -> HiddenFinding:
    """The finding with `earliest_s` and `latest_s` of those of its switches that unsteady records tell more of than
    the steady ones. `refitted`: with the effect in the states of the column STATE."""
    spans = [
        s for k, f in enumerate(evidence.flights) if (f.label, f.engine) in raw for s in _spans(finding, evidence, k)
    ]
    changed = [s for s in spans if s.before != s.after]
    if not changed:
        return finding
    longest = MOST_LENGTH * max(s.length for s in changed)
    known = [s for s in spans if s.is_known and 2.0 * LEFT_OUT * s.half_s < s.length <= longest]
    chosen = np.unique(np.linspace(0, len(known) - 1, min(len(known), MOST_STRETCHES)).astype(int)).tolist()
    stretches = _stretches([*(known[k] for k in chosen), *changed], refitted, evidence, raw)
    alike = [s for span, s in stretches if span.before == span.after]
    found: dict[tuple[str, float], tuple[Stretch, Errors]] = {}
    for group in _groups([(span, s) for span, s in stretches if span.before != span.after]):
        errors = _errors_of([s for _, s in group], alike)
        if errors is not None:
            found |= {(evidence.flights[span.k].label, span.begin_s): (s, errors) for span, s in group}
    several = Counter((s.flight, s.before_s) for s in finding.switches)
    # between two steady records a state is taken to have changed once: of more changes the readings may show any
    once = {key: told for key, told in found.items() if several[key] == 1}
    switches = tuple(_told(s, once.get((s.flight, s.before_s))) for s in finding.switches)
    return replace(finding, switches=switches)


def _groups(changed: list[tuple[_Span, Stretch]]) -> list[list[tuple[_Span, Stretch]]]:
    """Changes by how much the engine moves meanwhile, at most GROUPS."""
    ranked = sorted(changed, key=lambda c: c[1].moved)
    cuts = np.unique(np.linspace(0, len(ranked), min(GROUPS, len(ranked)) + 1).astype(int))
    return [ranked[a:b] for a, b in pairwise(cuts.tolist())]


def _errors_of(changed: Sequence[Stretch], known: Sequence[Stretch]) -> Errors | None:
    """Errors of known stretches in which the engine moves as much as in these; None where it moves in too few of them
    by as much: what is not seen where the state is known is no measure of what the model errs by here."""
    moved = float(np.exp(np.mean([np.log(s.moved) for s in changed])))
    most = max(s.moved for s in changed)
    if sum(s.moved >= AS_MUCH * most for s in known) < LEAST_AS_MUCH:
        return None
    return measured(sorted(known, key=lambda s: abs(np.log(s.moved / moved)))[:NEAREST])


def _told(switch: Switch, found: tuple[Stretch, Errors] | None) -> Switch:
    """The switch with its time; as it is where its stretch does not tell more than its ends."""
    if found is None:
        return switch
    low, high = interval(*found)
    if high - low >= NOTHING_LEARNT * (switch.time_s - switch.before_s):
        return switch
    return replace(switch, earliest_s=low, latest_s=high)


def _spans(finding: HiddenFinding, evidence: Dataset, k: int) -> list[_Span]:
    """Of flight k, between records whose state is told."""
    assert finding.states is not None
    first = sum(len(f) for f in evidence.flights[:k])
    flight = evidence.flights[k]
    time = np.asarray(flight.columns.get(TIME, np.full(len(flight), np.nan)), float)
    told = (finding.number >= first) & (finding.number < first + len(flight)) & (np.abs(finding.states - 0.5) > SURE)
    rows, states = finding.number[told] - first, finding.states[told] > 0.5
    t = time[rows]
    if len(t) < 2 or not (np.diff(t) > 0.0).all():
        return []
    half = 0.5 * float(np.median(np.diff(time)))
    ends = zip(pairwise(t.tolist()), pairwise(states.astype(float).tolist()), np.diff(rows) == 1, strict=True)
    return [_Span(k, *times, *sides, half, bool(whole)) for times, sides, whole in ends]


def _stretches(
    spans: Sequence[_Span], refitted: IdentifiedHypothesis, evidence: Dataset, raw: Raw
) -> list[tuple[_Span, Stretch]]:
    """What the model leaves between the ends of each span, of the sensors that all their flights have; without spans
    that hold too few records with a prediction."""
    compared = {}
    for k in dict.fromkeys(s.k for s in spans):
        flight = evidence.flights[k]
        columns = raw[flight.label, flight.engine]
        time = np.asarray(columns.get(TIME, ()), float)
        if len(time) and np.isfinite(time).all() and (np.diff(time) > 0.0).all():
            near = [(time >= s.begin_s - s.half_s) & (time <= s.end_s + s.half_s) for s in spans if s.k == k]
            rows = np.flatnonzero(np.any(near, axis=0))
            compared[k] = time[rows], *_compared(refitted, flight, {n: np.asarray(v)[rows] for n, v in columns.items()})
    if not compared:
        return []
    sensors = np.all([np.isfinite(e).any(axis=0) for _, e, *_ in compared.values()], axis=0)
    found = []
    for s in spans:
        if s.k in compared and sensors.any():
            t, *parts = compared[s.k]
            e, c, y = (p[:, sensors] for p in parts)
            whole = np.isfinite(e).all(axis=1) & np.isfinite(c).all(axis=1)
            stretch = _stretch(s, t[whole], e[whole], c[whole], y[whole])
            if stretch is not None:
                found.append((s, stretch))
    return found


def _stretch(span: _Span, t: np.ndarray, e: np.ndarray, c: np.ndarray, y: np.ndarray) -> Stretch | None:
    """Of a flight's records (n,), (n, m) those of the span, None where they are too few."""
    before = np.flatnonzero((t >= span.begin_s - span.half_s) & (t <= span.begin_s))
    after = np.flatnonzero((t >= span.end_s) & (t <= span.end_s + span.half_s))
    if not (before.size and after.size) or after[0] - before[-1] + 1 < LEAST_RECORDS:
        return None
    sides = ((before, span.before), (after, span.after))
    left = np.array([(e[rows] - c[rows] * state).mean(axis=0) for rows, state in sides])
    own = slice(before[-1], after[0] + 1)
    moved = float(np.maximum(np.ptp(y[own], axis=0).max(), 1.0))
    return Stretch(t[own], e[own], c[own], span.before, span.after, span.begin_s, span.end_s, left, moved)


def _compared(
    refitted: IdentifiedHypothesis, flight: Flight, columns: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals without the effect, what it moves and the prediction without it (n, m), in standard deviations; NaN
    where there is no reading or no prediction. What maps and instruments err by slowly goes with the line between the
    steady records."""
    model, problem = refitted.model, refitted.problem
    engine, n = model.engine, len(columns[TIME])
    inputs = {c: v for c, v in columns.items() if c in engine.inputs or c in engine.optional_inputs}
    both = []
    for state in (0.0, 1.0):
        theta = {name: v for name, v in refitted.theta.items() if name in engine.parameters}
        for d in model.discrepancies:
            share = state if d.curve == STATE else float(d.curve == f"engine {flight.engine}")
            before = theta.get(d.target, engine.parameters[d.target].nominal)
            theta[d.target] = before + share * refitted.theta[d.name]
        if STATE in engine.optional_inputs:
            inputs[STATE] = np.full(n, state)
        both.append(engine.predict(inputs, theta, sensors=problem.sensors).y)
    readings = np.column_stack([columns.get(s, np.full(n, np.nan)) for s in problem.sensors])
    return (readings - both[0]) / problem.sigma, (both[1] - both[0]) / problem.sigma, both[0] / problem.sigma
