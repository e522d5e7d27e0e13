"""Beam search over sets of members: add, drop and swap on the linear problem, noise estimated anew for the leaders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import log_ndtr

from enginediag_cli.discrepancy.candidates import SWITCH, Candidate, Screening
from enginediag_cli.discrepancy.linearised import LinearProblem
from enginediag_cli.discrepancy.noise import OWN_MAP_PRIOR, NoisePoint, StructuredNoise

LEAST_EVIDENCE = 5.0
"""ln evidence that a further member must bring: 150 to 1."""
LEADERS = (3, 1)
"""Candidates of each kind whose noise is estimated anew: at the noise of the present hypothesis, at its prior means."""
HOPELESS = -6.0
"""ln evidence at fixed noise below which a candidate is not refined: new noise brings some 5 where it brings most."""
ROUNDS = 3
"""Of noise and path in turn, for a switch."""
MOST_MEMBERS = 4
"""Members of a set at most: more causes at once are not distinguishable on a few flights."""
GROSS = 4.5
"""Standard deviations of a reading from what all others predict of it, beyond which it is a gross error (P. J. Huber,
Robust Statistics (1981), chapter 7: hard rejection)."""
GROSS_ROUNDS = 3
"""Of judging readings and estimating noise in turn."""
MEDIAN_OF_NORMAL = 0.6745
"""Median of |z| of a standard normal z."""
STEP = 0.05
"""Of finite differences of the gradient in ln size."""


@dataclass(frozen=True)
class MemberSet:
    """A hypothesis: its members, the noise under it, and `evidence`, ln marginal likelihood with all prices but those
    of places."""

    members: tuple[Candidate, ...]
    noise: StructuredNoise
    point: NoisePoint
    evidence: float

    def amplitude(self, k: int) -> np.ndarray:
        """Posterior mean of a member's amplitude in every record (N,), in its place's unit."""
        return np.asarray(self.members[k].patterns @ self.noise.amplitudes(self.point.eta, k)[0])

    @property
    def keys(self) -> frozenset[tuple[str, int, str]]:
        return frozenset(c.key for c in self.members)


@dataclass(frozen=True)
class TraceRow:
    """A hypothesis that was compared: its label, ln evidence over nothing, and whether its noise was estimated anew."""

    label: str
    evidence: float
    refined: bool
    members: int


@dataclass
class SearchResult:
    """Sets that were refined, likeliest first; `screened`: candidates of the last step that were not; `trace`."""

    nothing: MemberSet
    sets: list[MemberSet]
    screened: list[tuple[tuple[Candidate, ...], float]]
    trace: list[TraceRow] = field(default_factory=list)

    @property
    def sufficient(self) -> list[MemberSet]:
        """Sets of which every member brings enough, as far as the sets without it were compared, likeliest first."""
        known = {s.keys: s.evidence for s in self.sets}
        return [
            s
            for s in self.sets
            if all(s.evidence - known.get(s.keys - {k}, -np.inf) >= LEAST_EVIDENCE for k in s.keys) or not s.members
        ]


class BeamSearch:
    """One search of one problem."""

    def __init__(self, problem: LinearProblem):
        self.problem = problem
        self.screening = Screening(problem)
        self.known: dict[frozenset[tuple[str, int, str]], MemberSet] = {}
        self.trace: list[TraceRow] = []
        self._starts: dict[frozenset[tuple[str, int, str]], list[tuple[Candidate, ...]]] = {}

    @property
    def place_price(self) -> float:
        """ln prior of one place among all."""
        return -float(np.log(max(len(self.problem.places), 1)))

    def run(self) -> SearchResult:
        """Add the best member while it brings enough; then try to drop or swap each."""
        nothing = self._nothing()
        best = nothing
        screened: list[tuple[tuple[Candidate, ...], float]] = []
        while len(best.members) < MOST_MEMBERS:
            step, screened = self._step(best)
            if not step or step[0].evidence - best.evidence < LEAST_EVIDENCE:
                break
            best = self._swapped(step[0])
        sets = sorted(self.known.values(), key=lambda s: -s.evidence)
        return SearchResult(nothing, sets, screened, self.trace)

    def refine_again(self, sets: Sequence[MemberSet], nothing: MemberSet) -> list[MemberSet]:
        """Sets of another linearisation of the same readings, refined in this one."""
        self.known = {frozenset(): nothing}
        return [self.refine(s.members, s) for s in sets]

    def _nothing(self) -> MemberSet:
        noise = StructuredNoise(self.problem)
        low = noise.mean.copy()
        low[[n.startswith(("c:", "o:")) for n in noise.names]] -= 1.0
        points = [noise.optimise(), noise.optimise(low)]
        point = max(points, key=lambda p: p.value)
        for _ in range(GROSS_ROUNDS):
            gross = _gross_readings(noise, point)
            if not gross.any():
                break
            keep = self.problem.keep.copy()
            keep[noise.record[gross], noise.sensor[gross]] = False
            self.problem = replace(self.problem, keep=keep)
            noise = StructuredNoise(self.problem)
            point = noise.optimise(point.eta)
        found = MemberSet((), noise, point, point.value)
        self.known[found.keys] = found
        return found

    def _step(self, base: MemberSet) -> tuple[list[MemberSet], list[tuple[tuple[Candidate, ...], float]]]:
        """Sets of one more member, refined, likeliest first, and candidates that were only screened."""
        noise, members = base.noise, base.members
        mean = noise.start_from(noise, noise.mean)
        every: dict[tuple[str, int, str], Candidate] = {}
        chosen: list[Candidate] = []
        for number, eta in enumerate((base.point.eta, mean)):
            scored = [c for c in self.screening.score_all(noise, noise.whiten(eta)) if c.key not in base.keys]
            if number == 0:
                every = {c.key: c for c in scored}
            for kind in dict.fromkeys(c.kind for c in scored):
                leaders = [c for c in scored if c.kind == kind][: LEADERS[number]]
                leaders = [c for c in leaders if c.evidence + self.place_price > HOPELESS]
                chosen += [c for c in leaders if not any(c.same(x) for x in chosen)]
        chosen += self._freed_maps(base)
        found = [self.refine((*members, c), base) for c in chosen]
        found = sorted({s.keys: s for s in found}.values(), key=lambda s: -s.evidence)
        lift = 0.0
        if found:
            best = found[0].members[-1]
            lift = found[0].evidence - base.evidence - every.get(best.key, best).evidence
        rest = [
            ((*members, c), base.evidence + c.evidence + min(lift, 0.0) + self.place_price)
            for k, c in every.items()
            if k not in {x.key for x in chosen}
        ]
        for c, evidence in rest[:20]:
            self._record(c, evidence, refined=False)
        return found, rest

    def refine(self, members: Sequence[Candidate], start: MemberSet) -> MemberSet:
        """Noise, sizes and paths of a set estimated anew, in turn."""
        members = list(members)
        keys = frozenset(c.key for c in members)
        before, tried = self.known.get(keys), self._tried(members)
        if before is not None and tried:
            return before
        noise = self._noise(members)
        eta = noise.start_from(start.noise, start.point.eta)
        for k, c in enumerate(members):
            if c.prior is not None:
                eta[noise.index[f"size:{k}"]] = np.log(c.size)
        best = self._evaluated(members, noise, noise.optimise(eta))
        for _ in range(ROUNDS - 1):
            moved = self._paths_again(list(best.members), best)
            if all(np.array_equal(a.patterns, b.patterns) for a, b in zip(moved, best.members, strict=True)):
                break
            noise = self._noise(moved)
            new = self._evaluated(moved, noise, noise.optimise(best.point.eta))
            if new.evidence <= best.evidence:
                break
            best = new
        if before is not None and before.evidence >= best.evidence:
            return before
        self.known[keys] = best
        self._record(best.members, best.evidence, refined=True)
        return best

    def _noise(self, members: Sequence[Candidate]) -> StructuredNoise:
        freed = [k for c in members for k in c.free_maps(self.problem)]
        return StructuredNoise(self.problem, [c.columns(self.problem) for c in members], freed)

    def _freed_maps(self, base: MemberSet) -> list[Candidate]:
        """The machines whose map errors the readings would have larger, those most that gain by it first."""
        pull = base.point.gradient + (base.point.eta - base.noise.mean) / base.noise.sd**2
        gains = []
        for c in self.screening.map_candidates():
            own = [base.noise.index[f"maps:{self.problem.machines[k - 1]}"] for k in c.free_maps(self.problem)]
            gain = float(pull[own].max(initial=0.0))
            if c.key not in base.keys and gain > 0.0:
                gains.append((gain, c))
        return [c for _, c in sorted(gains, key=lambda item: -item[0])[: LEADERS[0]]]

    def _tried(self, members: Sequence[Candidate]) -> bool:
        """Whether a set has been refined from these very members."""
        done = self._starts.setdefault(frozenset(c.key for c in members), [])
        if any(all(a.same(b) for a, b in zip(members, x, strict=True)) for x in done):
            return True
        done.append(tuple(members))
        return False

    def _evaluated(self, members: Sequence[Candidate], noise: StructuredNoise, point: NoisePoint) -> MemberSet:
        value = point.value + sum(c.price + self.place_price for c in members)
        for k, c in enumerate(members):
            if c.prior is not None:
                value += _laplace(noise, point, noise.index[f"size:{k}"])
            for group in c.free_maps(self.problem):
                # over the width that the size has where it is not free
                own = noise.index[f"maps:{self.problem.machines[group - 1]}"]
                value += (
                    _laplace(noise, point, own) - 0.5 * float(np.log(2.0 * np.pi)) - float(np.log(OWN_MAP_PRIOR[1]))
                )
            if c.sign:
                value += _one_sided(noise, point, k, c.sign)
        return MemberSet(tuple(members), noise, point, value)

    def _paths_again(self, members: list[Candidate], of: MemberSet) -> list[Candidate]:
        """Every switch with its path at the present noise, the others held."""
        for k, c in enumerate(members):
            if c.kind == SWITCH:
                noise = self._noise([x for i, x in enumerate(members) if i != k])
                eta = noise.start_from(of.noise, of.point.eta)
                at = 0
                for i, x in enumerate(members):
                    if i != k:
                        if x.prior is not None:
                            eta[noise.index[f"size:{at}"]] = of.point.eta[of.noise.index[f"size:{i}"]]
                        at += 1
                members[k] = self.screening.again(c, noise, noise.whiten(eta))
        return members

    def _swapped(self, found: MemberSet) -> MemberSet:
        """The set with each member in turn exchanged for what is best beside the others, or dropped."""
        if len(found.members) < 2:
            return found
        for k in range(len(found.members)):
            others = tuple(c for i, c in enumerate(found.members) if i != k)
            base = self.refine(others, found)
            found = max(found, base, key=lambda s: s.evidence)
            step, _ = self._step(base)
            if step and step[0].evidence > found.evidence:
                found = step[0]
        return found

    def _record(self, members: Sequence[Candidate], evidence: float, *, refined: bool) -> None:
        nothing = self.known[frozenset()].evidence
        label = " + ".join(c.label(self.problem) for c in members) or "nothing"
        self.trace.append(TraceRow(label, evidence - nothing, refined, len(members)))


def _gross_readings(noise: StructuredNoise, point: NoisePoint) -> np.ndarray:
    """Readings (n,) that lie beyond GROSS of what all others predict, by the robust scale of their own sensor: a few of
    them widen the noise that they would be judged by."""
    white = noise.whiten(point.eta)
    z = white.alpha / np.sqrt(np.diag(white.precision))
    scale = np.array([np.median(np.abs(z[rows])) / MEDIAN_OF_NORMAL for rows in noise.blocks])
    return np.asarray(np.abs(z) > GROSS * np.minimum(scale, 1.0)[noise.sensor])


def _laplace(noise: StructuredNoise, point: NoisePoint, k: int) -> float:
    """½ ln 2π − ½ ln curvature in one hyper-parameter."""
    up, down = point.eta.copy(), point.eta.copy()
    up[k] += STEP
    down[k] -= STEP
    curvature = (noise.evaluate(down).gradient[k] - noise.evaluate(up).gradient[k]) / (2.0 * STEP)
    return 0.5 * float(np.log(2.0 * np.pi)) - 0.5 * float(np.log(max(curvature, noise.sd[k] ** -2)))


def _one_sided(noise: StructuredNoise, point: NoisePoint, member: int, sign: int) -> float:
    """ln of twice the posterior probability of the sign that physics gives."""
    mean, covariance = noise.amplitudes(point.eta, member)
    return float(np.log(2.0) + log_ndtr(sign * mean[0] / np.sqrt(covariance[0, 0])))
