"""What restoring the modules that an answer names would bring: of one window, and of the events of a series."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.isolation.adequacy import tempered
from enginediag_cli.isolation.belief import Belief, belief_of_components
from enginediag_cli.isolation.classes import Class
from enginediag_cli.isolation.of_windows import IsolatedWindow
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.isolation.story import Member, Story
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.work_scope.equal_power import PowerNotHeldError
from enginediag_cli.work_scope.gain import Gain, Moments, brought, gains
from enginediag_cli.work_scope.reference import Reference, plain_engine, reference_of

NOT_KNOWN = "the engine file gives neither thrust nor power at an operating point that could be held"


@dataclass(frozen=True)
class WorkScope:
    """Gains of restoring the modules, the largest first; empty with the `reason` where they cannot be told."""

    gains: tuple[Gain, ...] = ()
    reference: Reference | None = None
    reason: str = ""


class Scoping:
    """Work scopes of one monitored engine: its reference is found once."""

    def __init__(self, monitor: Monitor):
        self._monitor = monitor
        self.engine: Engine | None = plain_engine(monitor.engine)
        self._reference: Reference | None = None

    @property
    def base(self) -> Mapping[str, float]:
        """Parameters of the healthy engine as identified."""
        known = dict(zip(self._monitor.monitored, self._monitor.theta0.tolist(), strict=False))
        return {**self._monitor.base, **known}

    def reference(self, recorded: Mapping[str, float]) -> Reference | None:
        """Where gains are told; recorded: mean of what was recorded, for engines without another."""
        if self.engine is not None and self._reference is None:
            self._reference = reference_of(self.engine, self.base, recorded)
        return self._reference

    def of_isolated(self, found: IsolatedWindow, prior: SetPrior, largest: int | None = None) -> WorkScope | None:
        """Of a window as `isolate` answered it; None where nothing is named that stands, or by a method without a
        posterior. prior, largest: those of the isolation."""
        recorded = found.verdict.window.conditions
        if not found.named:
            return None
        if found.components is not None and found.score is not None:
            score = tempered(found.score, found.components.adequacy.noise)
            named = [c for each in _members(found.components.components, found.components.one_of) for c in each]
            return self.of_window(belief_of_components(score, prior, largest), named, recorded)
        if found.diagnosis is None or found.diagnosis.belief is None:
            return None
        result = found.diagnosis.result
        named = [n for each in _members(result.isolated, result.one_of) for n in each]
        return self.of_window(found.diagnosis.belief, named, recorded)

    def of_window(self, belief: Belief, named: Sequence[str], recorded: Mapping[str, float]) -> WorkScope:
        """Of the answer of one window; named: parameters or components."""
        mean, covariance = belief.moments()
        change = self._health(belief.score.described, mean, covariance)
        chosen = {p.component for p in belief.score.described if {p.name, p.component} & {*named}}
        return self._told(change, _modules(belief.score.described, change.names, chosen), recorded)

    def of_story(self, story: Story, known: Mapping[str, Parameter], recorded: Mapping[str, float]) -> WorkScope:
        """Of what changed during a series; of suspects that cannot be told apart each by itself, beside the likeliest
        of the other events."""
        healthy = [[m for m in event.named if m.expected and not m.instrument] for event in story.events]
        found: list[Gain] = []
        scope = WorkScope()
        for k, members in enumerate(healthy):
            for member in members:
                beside = [others[0] for j, others in enumerate(healthy) if j != k and others]
                change = _together([member, *beside], self.engine)
                modules = {member.component: [n for n in change.names if known[n].component == member.component]}
                scope = self._told(change, modules, recorded)
                if scope.reason:
                    return scope
                found += [g for g in scope.gains if g.module not in [f.module for f in found]]
        ordered = tuple(sorted(found, key=lambda g: -abs(g.temperature.value)))
        return WorkScope(ordered, scope.reference)

    def brought(
        self, before: np.ndarray, difference: Moments, recorded: Mapping[str, float]
    ) -> tuple[Gain | None, str]:
        """What the change `difference` from the level `before` (k,) did lower temperature and fuel by at equal power;
        or None with the reason. recorded: as of `reference`."""
        reference = self.reference(recorded)
        if self.engine is None or reference is None:
            return None, NOT_KNOWN
        try:
            return brought(self.engine, reference, self.base, before, difference), ""
        except PowerNotHeldError as error:
            return None, str(error)

    def _health(self, described: Sequence[Parameter], mean: np.ndarray, covariance: np.ndarray) -> Moments:
        known = self.engine.parameters if self.engine is not None else {}
        at = [i for i, p in enumerate(described) if not p.of_instrument and p.name in known]
        return Moments(tuple(described[i].name for i in at), mean[at], covariance[np.ix_(at, at)])

    def _told(self, change: Moments, modules: Mapping[str, Sequence[str]], recorded: Mapping[str, float]) -> WorkScope:
        modules = {name: own for name, own in modules.items() if own}
        if not modules:
            return WorkScope()
        reference = self.reference(recorded)
        if self.engine is None or reference is None:
            return WorkScope(reason=NOT_KNOWN)
        try:
            return WorkScope(gains(self.engine, reference, self.base, change, modules), reference)
        except PowerNotHeldError as error:
            return WorkScope(reference=reference, reason=str(error))


def _members(answer: tuple[str, ...], one_of: Class | None) -> tuple[tuple[str, ...], ...]:
    """The answer, and the members of the class where it is one."""
    return (answer, *one_of.members) if one_of is not None else (answer,)


def _modules(described: Sequence[Parameter], names: Sequence[str], chosen: set[str]) -> dict[str, list[str]]:
    """Components among the `chosen` with their parameters of `names`."""
    found: dict[str, list[str]] = {}
    for p in described:
        if p.name in names and p.component in chosen:
            found.setdefault(p.component, []).append(p.name)
    return found


def _together(members: Sequence[Member], engine: Engine | None) -> Moments:
    """All changes of several suspects, each independent of the others."""
    known = engine.parameters if engine is not None else {}
    names = tuple(dict.fromkeys(n for m in members for n in m.parameters if n in known))
    place = {n: i for i, n in enumerate(names)}
    mean, covariance = np.zeros(len(names)), np.zeros((len(names), len(names)))
    for m in members:
        own = [q for q, n in enumerate(m.parameters) if n in place]
        at = [place[m.parameters[q]] for q in own]
        mean[at] += np.array(m.expected)[own]
        covariance[np.ix_(at, at)] += np.array(m.covariance)[np.ix_(own, own)]
    return Moments(names, mean, covariance)
