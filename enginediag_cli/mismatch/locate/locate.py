"""Where model and recordings differ: a map of location × driver, judged as a whole before any of it is believed.

0. Fit what identification would absorb; is there a mismatch beyond it (`presence`)? If not, stop.
1. Score every location along every driver, time included (`freeform`, `time_steps`). Drivers that these flights
   cannot tell apart are one group. The best cells are fitted again with the full model, since a score is linear and
   a large effect is not: the fall of χ² of that fit is what they are ranked by.
2. Look for an amplitude that no driver explains (`hidden`): something that switches, or varies with what is not
   recorded.
3. The answer is a set: all cells whose −ln p is within REACH + BENT·T of the best, which is what noise and the
   linearisation can turn round.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.drivers import TIME, groups
from enginediag_cli.engine.term import DriverValues
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.freeform import Cell, free_form, machine_cells
from enginediag_cli.mismatch.fit.identified import (
    NULL_HYPOTHESIS,
    Hypothesis,
    IdentifiedHypothesis,
    Nuisance,
    driver_values,
    identify_with,
    nuisance,
)
from enginediag_cli.mismatch.fit.noise import estimated_noise, with_noise
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.scores import surprise
from enginediag_cli.mismatch.locate.moving_drivers import moving_drivers
from enginediag_cli.mismatch.locate.presence import HIDDEN_SHARE, Presence, presence
from enginediag_cli.mismatch.locate.stability import resampled_surprise
from enginediag_cli.mismatch.locate.time_steps import step_drivers
from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding, hidden_amplitudes
from enginediag_cli.progress import stage

REACH, BENT = 4.6, 0.02
"""Cells within a factor of 100 of the best in p, and 2 % of its χ² for what linearisation may have got wrong."""

REFITS, MOST_REFITS = 6, 12
"""Cells fitted again: the first few, and all within reach up to a limit."""

TOLD = 0.95
"""Of the probability of all groups of drivers: those that hold it together are told together."""

NOISE_PASSES = 2
"""Estimates of the noise at a fit, each with a fit after it; a third changes nothing that matters."""
WIDE = 10.0
"""Prior of a free-form coefficient in a refit, in units of its one-step estimate plus standard error."""


@dataclass(frozen=True)
class Place:
    """One location × group of drivers. `cell` is the best driver's of the group, whose members are told in `words`, and
    `driver` the one by which it is told; `surprise` −ln p, after a refit with
    the full model where `refit` is "converged"; `p` adjusted for all that was looked at; `share` of the excess χ² that
    it explains; `stability`: share of resamples in which it is the first of all; `within` reach of the best."""

    cell: Cell
    group: str
    words: tuple[str, ...]
    statistic: float
    surprise: float
    p: float
    share: float
    stability: float
    refit: str = ""
    within: bool = False
    driver: str = ""

    @property
    def worth(self) -> float:
        """−ln p less the strain of what it takes: by this places are ranked."""
        return self.surprise - self.cell.strain

    @property
    def location(self) -> str:
        return self.cell.location.name

    @property
    def component(self) -> str:
        return self.cell.location.component


@dataclass(frozen=True)
class Lead:
    """A group of drivers by its best place, told by its `driver`; `stability`: share of resamples that it leads;
    `probability` of the groups beside each other; `told`: one of those that hold TOLD of it together."""

    group: str
    driver: str
    words: tuple[str, ...]
    surprise: float
    p: float
    stability: float
    within: bool
    probability: float = 0.0
    told: bool = False


@dataclass(frozen=True)
class Located:
    """`places` and `leads`, best first; `resampled` says what was drawn for stability; `hidden`: significant findings
    of an unrecorded driver, likeliest first. `reason` is for a fit that did not converge, with nothing else in it."""

    converged: bool
    reason: str
    found: IdentifiedHypothesis
    projection: Projection | None = None
    presence: Presence | None = None
    places: tuple[Place, ...] = ()
    leads: tuple[Lead, ...] = ()
    resampled: str = ""
    hidden: tuple[HiddenFinding, ...] = ()

    @property
    def mismatch(self) -> bool:
        """Whether anything is there beyond noise and identified parameters."""
        return bool(self.hidden) or (self.presence is not None and self.presence.found)

    @property
    def within(self) -> tuple[Place, ...]:
        return tuple(p for p in self.places if p.within)

    def carrying(self, cell: Cell) -> Projection | None:
        """Of a fit that has a cell's curve; None where it does not converge."""
        evidence = self.found.evidence
        fit = identify_with(evidence, free_hypothesis(cell, self.found), nuisance(evidence), self.found)
        return Projection(fit) if fit.converged else None


def locate(evidence: Dataset) -> Located:
    """The map of a mismatch. Raises DataError where the recordings make no problem."""
    rng = np.random.default_rng(evidence.settings.seed)
    along = nuisance(evidence)
    found = identify_with(evidence, NULL_HYPOTHESIS, along)
    if not found.converged:
        return Located(False, found.reason, found)
    projection = Projection(found)
    conditions = [*driver_values(evidence, found.theta), *moving_drivers(evidence)]
    everything = [*conditions, *step_drivers(evidence)]
    cells = free_form(found, projection, everything)
    if evidence.settings.noise == "estimate":
        for _ in range(NOISE_PASSES):
            noise = estimated_noise(projection, [c for c in cells if not c.score.absorbed])
            evidence = with_noise(evidence, noise)
            found = identify_with(evidence, NULL_HYPOTHESIS, along, found)
            if not found.converged:
                return Located(False, found.reason, found)
            projection = Projection(found)
            cells = free_form(found, projection, everything)
    judged = presence(projection, cells, conditions, rng)
    places = _grouped([*cells, *machine_cells(cells)], conditions)
    drawn, what = resampled_surprise(projection, [p.cell for p in places], rng)
    places = _stable(places, drawn)
    if judged.located:
        places = _refitted(places, found, along, projection)
    places = _judged(places, judged, projection)
    level = HIDDEN_SHARE * evidence.settings.false_alarm
    hidden = tuple(f for f in hidden_amplitudes(found, projection, level=level, rng=rng, along=along) if f.significant)
    return Located(True, "", found, projection, judged, tuple(places), tuple(_leads(places)), what, hidden)


def grouped_drivers(conditions: Sequence[DriverValues]) -> dict[str, tuple[DriverValues, ...]]:
    """Driver, by name → the members of its group, first the one that the drivers' order puts first."""
    return {d.name: tuple(members) for members in groups(conditions) for d in members}


def _grouped(cells: Sequence[Cell], conditions: Sequence[DriverValues]) -> list[Place]:
    """The best cell of every location and group, most surprising first, as it is scored."""
    alike = grouped_drivers(conditions) if conditions else {}
    best: dict[tuple[str, str], Place] = {}
    for c in sorted(cells, key=lambda c: c.strain - c.surprise):
        in_time = c.driver.driver == TIME
        own = [d for d in conditions if d.driver == c.varies_with and c.varies_with != c.driver.driver]
        named = own[0] if len(own) == 1 else c.driver
        members = alike.get(named.name, (named,))
        group = TIME.word if in_time else " = ".join(d.name for d in members)
        words = (TIME.word,) if in_time else tuple(d.short for d in members)
        if not c.score.absorbed:
            place = Place(c, group, words, c.score.statistic, c.surprise, 1.0, 0.0, 0.0, driver=named.name)
            best.setdefault((c.location.name, group), place)
    return sorted(best.values(), key=lambda p: -p.worth)


def _stable(places: Sequence[Place], drawn: np.ndarray) -> list[Place]:
    if not places:
        return []
    first = np.bincount(drawn.argmax(axis=1), minlength=len(places)) / len(drawn)
    return [replace(p, stability=float(s)) for p, s in zip(places, first, strict=True)]


@stage("fitting the leading places")
def _refitted(places: Sequence[Place], found: IdentifiedHypothesis, along: Nuisance, base: Projection) -> list[Place]:
    """The first few with the fall of χ² of a fit with the full model instead of the score."""
    result: list[Place] = []
    reach = REACH + BENT * places[0].statistic if places else 0.0
    for number, p in enumerate(places):
        near = places[0].worth - p.worth <= reach
        if number < REFITS or (near and number < MOST_REFITS):
            fit = identify_with(found.evidence, free_hypothesis(p.cell, found), along, found)
            if fit.converged:
                fall = max(0.0, base.objective - Projection(fit).objective)
                told = float(surprise(fall, p.cell.score.dof))
                p = replace(p, statistic=fall, surprise=told, refit="converged")
            else:
                p = replace(p, refit="did not converge")
        result.append(p)
    return result


def free_hypothesis(cell: Cell, found: IdentifiedHypothesis) -> Hypothesis:
    """The cell as something to fit: its curves on its parameter, with a prior too wide to matter."""
    n = sum(len(next(iter(f.columns.values()))) for f in found.evidence.flights)
    curves, discrepancies = {}, []
    error = np.sqrt(max(cell.score.statistic, 1.0)) / max(cell.score.length, 1e-300)
    parts = cell.location.parts
    each = len(cell.candidates) // len(parts)
    for j, curve in enumerate(cell.curves.T):
        key = f"free {cell.location.name} {cell.driver.name} {j + 1}"
        full = np.zeros(n)
        full[found.number] = curve
        curves[key] = full
        guess = abs(float(cell.score.coefficients[j])) if j < len(cell.score.coefficients) else 0.0
        discrepancies.append(Discrepancy(parts[j // each].parameter, key, WIDE * (guess + error)))
    place = cell.location
    there = {e.label for e in (*found.evidence.engine.effects, *found.hypothesis.effects)}
    effects = (place.through,) if place.through is not None and place.through.label not in there else ()
    return Hypothesis(effects, tuple(discrepancies), curves)


def _judged(places: Sequence[Place], judged: Presence, projection: Projection) -> list[Place]:
    """Significance, share explained and the set within reach; refitted places lead, the others follow by score."""
    if not places:
        return []
    refit = [p for p in places if p.refit == "converged"]
    rest = [p for p in places if p.refit != "converged"]
    order = [*sorted(refit, key=lambda p: -p.worth), *sorted(rest, key=lambda p: -p.worth)]
    top = max(places, key=lambda p: p.cell.surprise - p.cell.strain)
    first = order[0]
    reach = REACH + BENT * max(first.statistic, top.cell.score.statistic)
    # what there is to be explained: at least what the best place explains
    excess = max(projection.objective - projection.dof, first.statistic - first.cell.score.dof, 1e-300)
    result = []
    for p in order:
        best = first.worth if p.refit == "converged" else top.cell.surprise - top.cell.strain
        share = float(np.clip((p.statistic - p.cell.score.dof) / excess, 0.0, 1.0))
        within = judged.located and best - p.worth <= reach
        result.append(replace(p, p=judged.adjusted(p.surprise), share=share, within=bool(within)))
    return result


def _leads(places: Sequence[Place]) -> list[Lead]:
    """Groups of drivers, best first: by what all their places say together, ln Σ exp(worth), since a driver may be told
    where its place is not. Those behind the first that have not TOLD without them are one answer with it."""
    members: dict[str, list[Place]] = {}
    for p in places:
        members.setdefault(p.group, []).append(p)
    together = {g: float(np.logaddexp.reduce([p.worth for p in own])) for g, own in members.items()}
    best, found, before = max(together.values(), default=0.0), [], 0.0
    total = sum(np.exp(t - best) for t in together.values())
    for g in sorted(members, key=lambda g: -together[g]):
        own, probability = members[g], float(np.exp(together[g] - best) / total)
        stability, within = min(1.0, sum(p.stability for p in own)), any(p.within for p in own)
        told = within and before < TOLD
        lead = Lead(g, own[0].driver, own[0].words, own[0].surprise, own[0].p, stability, within, probability, told)
        found.append(lead)
        before += probability
    return found
