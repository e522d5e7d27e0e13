"""What the model lacks, from recordings: the fit without effects, the search, the posterior, the answer.

An answer is a finding where its set brings LEAST_EVIDENCE over nothing and every member moves some reading by more than
the model is expected to err by: what is smaller may be a real error of the model, and is none that anybody looks for.

The posterior: a set has the prior ½ where it is empty, else ½ spread evenly over kinds, and over places, paths, drivers
and lengths as the prices of its members say; its likelihood is its evidence. What was only screened counts with the
evidence at the noise of the last leader.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from enginediag_cli.discrepancy.candidates import KINDS, SWITCH, Candidate
from enginediag_cli.discrepancy.linearised import LinearProblem, fit_without_effects, linearise
from enginediag_cli.discrepancy.search import LEAST_EVIDENCE, BeamSearch, MemberSet, SearchResult, TraceRow
from enginediag_cli.mismatch.fit.evidence import Dataset

LEAST_VISIBLE = 1.0
"""Twice the rms of what a member moves a reading by beside all that identification may absorb, in stated standard
deviations, at least in one sensor."""
SCATTER_REPORTED = 1.5
"""Noise over its stated standard deviation from which it is a finding by itself."""
SAME_CLASS = 3.0
"""ln evidence within which alternatives of the likeliest are one ambiguity group: 20 to 1."""


@dataclass(frozen=True)
class DiscrepancyPosterior:
    """`nothing`: P(nothing is missing); the others are probabilities of the place, driver and kind of a member;
    `group`: names of places within SAME_CLASS of the likeliest, likeliest first."""

    nothing: float
    places: Mapping[str, float]
    drivers: Mapping[str, float]
    kinds: Mapping[str, float]
    group: tuple[str, ...]


@dataclass(frozen=True)
class FoundMember:
    """A member of the answer: the place by name and in words, kind, driver, `size` with its standard deviation in
    `unit`: of a switch its amplitude, else the rms of what varies; `visible`: what it moves each sensor's readings
    by, in stated standard deviations; `on_s`: intervals in which a switch is on, s."""

    place: str
    words: str
    kind: str
    driver: str
    size: float
    standard_deviation: float
    unit: str
    visible: Mapping[str, float]
    on_s: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class DiscrepancyAnswer:
    """`members`: none where nothing is found; `evidence`: ln evidence of the likeliest set over nothing; `found`:
    whether it is a finding; `scatter`: noise of each sensor over what is stated, under the answer."""

    found: bool
    members: tuple[FoundMember, ...]
    evidence: float
    posterior: DiscrepancyPosterior
    scatter: Mapping[str, float]
    trace: tuple[TraceRow, ...]
    records: int

    @property
    def excess_scatter(self) -> dict[str, float]:
        """Sensors that scatter more than SCATTER_REPORTED times their stated noise."""
        return {s: v for s, v in self.scatter.items() if v > SCATTER_REPORTED}

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return asdict(self)

    def summary(self) -> str:
        """The answer in a few lines."""
        lines = [
            f"Readings of {s} scatter {v:.1f} times their stated noise: the stated noise is wrong, or something that "
            "is not recorded changes from record to record."
            for s, v in self.excess_scatter.items()
        ]
        if not self.found:
            lines.append(f"Nothing is missing that is certain (ln evidence {self.evidence:.1f}).")
        for m in self.members if self.found else ():
            along = f" along {m.driver}" if m.driver else ", not recorded"
            lines.append(
                f"{m.words}: {m.kind}{along}, {m.size:.3g} ± {m.standard_deviation:.2g} {m.unit} "
                f"(place {self.posterior.places.get(m.place, 0.0):.2f}, ln evidence {self.evidence:.1f})"
            )
        return "\n".join(lines)


def explain_discrepancy(dataset: Dataset) -> DiscrepancyAnswer:
    """Search recordings for what the model lacks.

    Parameters
    ----------
    dataset : Dataset
        Engine, flights, stated noise and priors.

    Returns
    -------
    DiscrepancyAnswer
        The likeliest set, the posterior over everything that was compared, and the trace.
    """
    problem = linearise(fit_without_effects(dataset))
    search = BeamSearch(problem)
    return answer_from_search(search.run(), search.problem)


def answer_from_search(result: SearchResult, problem: LinearProblem) -> DiscrepancyAnswer:
    """The likeliest set as an answer."""
    best, found = result.sets[0], False
    for s in result.sets:
        if not s.members or s.evidence - result.nothing.evidence < LEAST_EVIDENCE:
            break
        if all(_exceeds(_member(problem, s, k), problem) for k in range(len(s.members))):
            best, found = s, True
            break
    members = tuple(_member(problem, best, k) for k in range(len(best.members)))
    evidence = best.evidence - result.nothing.evidence
    return DiscrepancyAnswer(
        found,
        members,
        evidence,
        posterior_over_sets(problem, result),
        best.noise.scatter(best.point.eta),
        tuple(result.trace),
        int(problem.count.sum()),
    )


def _exceeds(member: FoundMember, problem: LinearProblem) -> bool:
    """Whether a member moves readings by more than the model errs anyway: within seconds, by the stated noise; along
    a driver, by what identification found on readings that it had not seen."""
    expected = np.ones(len(problem.sensors)) if member.kind == SWITCH else problem.expected
    return any(member.visible[s] >= LEAST_VISIBLE * e for s, e in zip(problem.sensors, expected, strict=True))


def _member(problem: LinearProblem, found: MemberSet, k: int) -> FoundMember:
    c = found.members[k]
    place = problem.places[c.place]
    mean, covariance = found.noise.amplitudes(found.point.eta, k)
    amplitude = c.patterns @ mean
    if c.kind == SWITCH:
        size, sd = float(mean[0]), float(np.sqrt(covariance[0, 0]))
    else:
        size = float(np.sqrt(np.mean(amplitude**2)))
        along = c.patterns.T @ amplitude / max(size * len(amplitude), 1e-300)
        sd = float(np.sqrt(along @ covariance @ along))
    on = _intervals(problem, c) if c.kind == SWITCH else ()
    return FoundMember(
        place.name,
        place.words,
        c.kind,
        c.driver,
        size,
        sd,
        place.unit,
        visible_size(problem, problem.G[:, :, c.place] * amplitude[:, None]),
        on,
    )


def visible_size(problem: LinearProblem, moved: np.ndarray) -> dict[str, float]:
    """Twice the rms by sensor of what moves the readings (N, m) beside all that identification may absorb."""
    X, v = problem.X[problem.keep], moved[problem.keep]
    absorbed = X @ np.linalg.solve(np.eye(X.shape[1]) + X.T @ X, X.T @ v)
    left = np.zeros(moved.shape)
    left[problem.keep] = v - absorbed
    readings = np.maximum(problem.keep.sum(axis=0), 1)
    size = 2.0 * np.sqrt((left**2).sum(axis=0) / readings)
    return dict(zip(problem.sensors, map(float, size), strict=True))


def _intervals(problem: LinearProblem, c: Candidate) -> tuple[tuple[float, float], ...]:
    """First and last time, s, of each run of records in which a switch is on; numbers of records without a clock."""
    z = c.patterns[:, 0] > 0.0
    time = problem.time_s if problem.has_clock else np.arange(len(z), dtype=float)
    edge = np.flatnonzero((z[1:] != z[:-1]) | (problem.flight[1:] != problem.flight[:-1])) + 1
    runs = zip([0, *edge], [*edge, len(z)], strict=True)
    return tuple((float(time[a]), float(time[b - 1])) for a, b in runs if z[a])


def posterior_over_sets(problem: LinearProblem, result: SearchResult) -> DiscrepancyPosterior:
    """Marginals over everything that was compared."""
    every: list[tuple[tuple[Candidate, ...], float]] = [(s.members, s.evidence) for s in result.sets]
    every += result.screened
    kinds = float(np.log(len(KINDS)))
    logs = np.array([e - kinds * len(members) for members, e in every])
    p = np.exp(logs - np.logaddexp.reduce(logs))
    nothing = float(sum(q for (members, _), q in zip(every, p, strict=True) if not members))
    places = _marginal(every, p, lambda c: problem.places[c.place].name)
    drivers = _marginal(every, p, lambda c: c.driver or "not recorded")
    return DiscrepancyPosterior(
        nothing, places, drivers, _marginal(every, p, lambda c: c.kind), _group(problem, result.sets)
    )


def _marginal(
    every: Sequence[tuple[tuple[Candidate, ...], float]], p: np.ndarray, name: Callable[[Candidate], str]
) -> dict[str, float]:
    """Probability of each name among the members, largest first."""
    found: dict[str, float] = {}
    for (members, _), q in zip(every, p, strict=True):
        for n in {name(c) for c in members}:
            found[n] = found.get(n, 0.0) + float(q)
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _group(problem: LinearProblem, sets: Sequence[MemberSet]) -> tuple[str, ...]:
    """Places of the first member of sets as large as the likeliest, within SAME_CLASS."""
    best = sets[0]
    if not best.members:
        return ()
    near = [s for s in sets if len(s.members) == len(best.members) and s.evidence > best.evidence - SAME_CLASS]
    return tuple(dict.fromkeys(problem.places[c.place].name for s in near for c in s.members))
