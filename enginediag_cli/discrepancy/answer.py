"""The answer of the search for what the model lacks: the likeliest set, one posterior over all that was compared.

An answer is a finding where its set brings LEAST_EVIDENCE over nothing and every member moves some reading by more than
the model is expected to err by: what is smaller may be a real error of the model, and is none that anybody looks for.

The posterior: a set has the prior ½ where it is empty, else ½ spread evenly over kinds, and over places, paths, drivers
and lengths as the prices of its members say; its likelihood is its evidence. What was only screened counts with the
evidence at the noise of the last leader. A member that is smaller than the model's own error is a description of that
error: a set of such members alone counts as nothing missing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from enginediag_cli.discrepancy.candidates import CURVE, KINDS, MAP, STEP, SWITCH, Candidate
from enginediag_cli.discrepancy.linearised import LinearProblem
from enginediag_cli.discrepancy.search import MemberSet, SearchResult, TraceRow

LEAST_VISIBLE = 1.0
"""Twice the rms of what a member moves a reading by beside all that identification may absorb, in stated standard
deviations, at least in one sensor."""
SCATTER_REPORTED = 1.5
"""Noise over its stated standard deviation from which it is a finding by itself."""
NEGLIGIBLE = 1e-6
"""Probability of a set below which it is not looked at more closely."""
SAME_CLASS = 3.0
"""ln evidence within which alternatives of the likeliest are one ambiguity group: 20 to 1."""


@dataclass(frozen=True)
class DiscrepancyPosterior:
    """`nothing`: P(nothing is missing that is larger than the model errs by); the others are probabilities of the
    place, driver and kind of a member; `group`: names of places within SAME_CLASS of the likeliest, likeliest first."""

    nothing: float
    places: Mapping[str, float]
    drivers: Mapping[str, float]
    kinds: Mapping[str, float]
    group: tuple[str, ...]


@dataclass(frozen=True)
class FoundMember:
    """A member of the answer: the place by name and in words, kind, driver, `size` with its standard deviation in
    `unit`: of a switch its amplitude, else the rms of what varies; `visible`: what it moves each sensor's readings
    by, in stated standard deviations; `on_s`: intervals in which a switch is on, s; `times_stated`: of a map error, its
    size over what is stated; `threshold`: value of the driver at which a step is."""

    place: str
    words: str
    kind: str
    driver: str
    size: float
    standard_deviation: float
    unit: str
    visible: Mapping[str, float]
    on_s: tuple[tuple[float, float], ...] = ()
    times_stated: float = 0.0
    threshold: float | None = None


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

    def why_not(self, name: str) -> str:
        """What became of hypotheses whose label has this text in it.

        Parameters
        ----------
        name : str
            A place or kind in words, such as "HPC isentropic efficiency" or "two states".

        Returns
        -------
        str
            The likeliest such hypothesis with its ln evidence, or that none was compared.
        """
        rows = [r for r in self.trace if name in r.label]
        if not rows:
            return f"{name}: not compared."
        best = max(rows, key=lambda r: r.evidence)
        how = "with the noise estimated anew" if best.refined else "at fixed noise"
        behind = self.evidence - best.evidence
        value = f"ln evidence {best.evidence:.1f} {how}"
        return f"{name}: compared as {best.label}, {value}, {behind:.1f} behind the likeliest."

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
            if m.times_stated:
                lines.append(
                    f"The map of {m.words} is wrong by {100 * m.size:.1f} % along {m.driver}, "
                    f"{m.times_stated:.0f} times what is stated (ln evidence {self.evidence:.1f})."
                )
                continue
            at = "" if m.threshold is None else f" at {m.threshold:.5g}"
            along = f" along {m.driver}" if m.driver else ", not recorded"
            lines.append(
                f"{m.words}: {m.kind}{along}{at}, {m.size:.3g} ± {m.standard_deviation:.2g} {m.unit} "
                f"(place {self.posterior.places.get(m.place, 0.0):.2f}, ln evidence {self.evidence:.1f})"
            )
        return "\n".join(lines)


def answer_from_search(result: SearchResult, problem: LinearProblem) -> DiscrepancyAnswer:
    """The likeliest set as an answer."""
    best, found = result.sets[0], False
    described = SetDescriptions(problem)
    for s in result.sufficient:
        if not s.members:
            break
        if all(described.larger(s)):
            best, found = s, True
            break
    members = described.members(best)
    evidence = best.evidence - result.nothing.evidence
    return DiscrepancyAnswer(
        found,
        members,
        evidence,
        posterior_over_sets(described, result),
        best.noise.scatter(best.point.eta),
        tuple(result.trace),
        int(problem.count.sum()),
    )


def _exceeds_errors(problem: LinearProblem, kind: str, visible: Mapping[str, float]) -> bool:
    """Whether a member moves readings by more than the model errs anyway: within seconds, by the stated noise; along
    a driver, by what identification found on readings that it had not seen."""
    expected = np.ones(len(problem.sensors)) if kind == SWITCH else problem.expected
    return any(visible[s] >= LEAST_VISIBLE * e for s, e in zip(problem.sensors, expected, strict=True))


def _member(problem: LinearProblem, found: MemberSet, k: int) -> FoundMember:
    c = found.members[k]
    if c.kind == MAP:
        return _map_member(problem, found, c)
    place = problem.places[c.place]
    mean, covariance = found.noise.amplitudes(found.point.eta, k)
    amplitude = c.patterns @ mean
    if c.kind in (SWITCH, STEP):
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
        size / problem.map_accuracy if c.kind == CURVE and place.name in problem.machines else 0.0,
        c.length if c.kind == STEP else None,
    )


def _map_member(problem: LinearProblem, found: MemberSet, c: Candidate) -> FoundMember:
    """The larger of a machine's map errors, and the driver that it follows best."""
    best: tuple[float, int, np.ndarray, np.ndarray] | None = None
    for group in c.free_maps(problem):
        place = problem.place(problem.machines[group - 1])
        moved = found.noise.group_signature(found.point.eta, group)
        g = problem.G[:, :, place] * problem.keep
        amplitude = (g * moved).sum(axis=1) / np.maximum((g**2).sum(axis=1), 1e-300)
        size = float(np.sqrt(np.mean(amplitude**2)))
        if best is None or size > best[0]:
            best = size, place, amplitude, moved
    assert best is not None
    size, number, amplitude, moved = best
    own = problem.places[number]
    along = max(problem.drivers, key=lambda d: _followed(amplitude, d.values))
    ratio = found.noise.map_size(found.point.eta, problem.machines.index(own.name) + 1)
    return FoundMember(
        own.name,
        own.words,
        MAP,
        along.short,
        size,
        size / max(ratio, 1e-300),
        own.unit,
        visible_size(problem, moved, problem.groups == 0),
        (),
        ratio,
    )


def _followed(amplitude: np.ndarray, driver: np.ndarray) -> float:
    """Share of the variance of an amplitude that a parabola along a driver follows."""
    x = np.where(np.isfinite(driver), driver, np.nanmean(driver))
    A = np.vander((x - x.mean()) / max(float(x.std()), 1e-300), 3)
    left = amplitude - A @ np.linalg.lstsq(A, amplitude, rcond=None)[0]
    return 1.0 - float(np.var(left)) / max(float(np.var(amplitude)), 1e-300)


def visible_size(problem: LinearProblem, moved: np.ndarray, columns: np.ndarray | None = None) -> dict[str, float]:
    """Twice the rms by sensor of what moves the readings (N, m) beside all that identification may absorb."""
    X, v = problem.X[problem.keep], moved[problem.keep]
    X = X if columns is None else X[:, columns]
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


class SetDescriptions:
    """The members of the sets of a problem as they are reported; each set is described once, which takes its noise."""

    def __init__(self, problem: LinearProblem):
        self.problem = problem
        self._known: dict[int, tuple[MemberSet, tuple[FoundMember, ...]]] = {}

    def members(self, found: MemberSet) -> tuple[FoundMember, ...]:
        """As reported."""
        if id(found) not in self._known:
            own = tuple(_member(self.problem, found, k) for k in range(len(found.members)))
            self._known[id(found)] = found, own
        return self._known[id(found)][1]

    def larger(self, found: MemberSet) -> list[bool]:
        """Of each member, whether it moves readings by more than the model errs by."""
        return [_exceeds_errors(self.problem, member.kind, member.visible) for member in self.members(found)]


def posterior_over_sets(described: SetDescriptions, result: SearchResult) -> DiscrepancyPosterior:
    """Marginals over everything that was compared."""
    problem = described.problem
    every = [(s.members, s.evidence) for s in result.sets] + list(result.screened)
    logs = np.array([e - float(np.log(len(KINDS))) * len(members) for members, e in every])
    p = np.exp(logs - np.logaddexp.reduce(logs))
    refined = len(result.sets)
    missing = []
    for k, ((members, _), q) in enumerate(zip(every, p.tolist(), strict=True)):
        if q < NEGLIGIBLE:
            larger = members
        elif k < refined:
            larger = tuple(c for c, exceeds in zip(members, described.larger(result.sets[k]), strict=True) if exceeds)
        else:
            larger = members if len(members) > 1 or _may_exceed(problem, members[-1]) else ()
        missing += [(larger, q)] if larger else []
    return DiscrepancyPosterior(
        max(1.0 - sum(q for _, q in missing), 0.0),
        _marginal(missing, lambda c: problem.places[c.place].name),
        _marginal(missing, lambda c: c.driver or "not recorded"),
        _marginal(missing, lambda c: c.kind),
        _group(problem, result.sufficient),
    )


def _may_exceed(problem: LinearProblem, c: Candidate) -> bool:
    """Whether a candidate that was only screened is larger than the model's errors, by the size that it then had."""
    if c.kind == MAP:
        return True
    amplitude = c.size * np.sqrt((c.patterns**2).sum(axis=1))
    visible = visible_size(problem, problem.G[:, :, c.place] * amplitude[:, None])
    return _exceeds_errors(problem, c.kind, visible)


def _marginal(
    missing: Sequence[tuple[tuple[Candidate, ...], float]], name: Callable[[Candidate], str]
) -> dict[str, float]:
    """Probability of each name among the members of sets with their probabilities, largest first."""
    found: dict[str, float] = {}
    for members, q in missing:
        for n in {name(c) for c in members}:
            found[n] = found.get(n, 0.0) + q
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _group(problem: LinearProblem, sets: Sequence[MemberSet]) -> tuple[str, ...]:
    """Places of the first member of sets as large as the likeliest, within SAME_CLASS."""
    best = sets[0]
    if not best.members:
        return ()
    near = [s for s in sets if len(s.members) == len(best.members) and s.evidence > best.evidence - SAME_CLASS]
    return tuple(dict.fromkeys(problem.places[c.place].name for s in near for c in s.members))
