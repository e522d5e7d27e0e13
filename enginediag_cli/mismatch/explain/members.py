"""Members of a set: what they are, and when two sets hold the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from enginediag_cli.drivers import TIME
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.options import EFFECT, FORMULA_OPTION, FREE, Option, effect_option
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.physics.registry import separate_effects

MOST_MEMBERS = 6
"""Options that may act together at most. Judgement: more together is better told as unlisted physics."""
PACE = 3.0
"""Times the gain of the last round that each further member may bring: they come largest first. Judgement."""

Members = tuple[Option, ...]
Held = frozenset[tuple[str, ...]]
"""What a set holds, whatever its order, times and sizes."""


def identity(option: Option) -> tuple[str, ...]:
    """What it is, whenever it began and at whatever size it is tried."""
    if option.driver == TIME:
        return tuple(d.target for d in option.hypothesis.discrepancies)
    return (option.label,)


def held(options: Sequence[Option]) -> Held:
    """What these are; of what is not listed only the places, whatever its form."""
    return frozenset(_what(o) for o in options)


def _what(option: Option) -> tuple[str, ...]:
    if option.kind not in (FORMULA_OPTION, FREE):
        return identity(option)
    moved = [d.target for d in option.hypothesis.discrepancies] + [e.site.name for e in option.hypothesis.effects]
    return ("unlisted", *dict.fromkeys(moved))


def at_once(trial: HypothesisFit) -> int:
    """At how many places anything acts."""
    effects = (e for o in trial.options for e in o.hypothesis.effects)
    return sum(len(separate_effects(e)) for e in effects) + sum(bool(o.hypothesis.discrepancies) for o in trial.options)


def law_places(trial: HypothesisFit) -> int:
    """At how many places it has laws."""
    return len(
        {n for o in trial.options if o.kind == FORMULA_OPTION for e in o.hypothesis.effects for n in e.site.targets}
    )


def different(trials: Sequence[HypothesisFit]) -> list[HypothesisFit]:
    """The first of those that hold the same: begun at another time they are no rivals."""
    first: dict[frozenset[tuple[str, ...]], HypothesisFit] = {}
    for t in trials:
        first.setdefault(frozenset(map(identity, t.options)), t)
    return list(first.values())


def clashes(option: Option, members: Sequence[Option]) -> bool:
    """Whether it is no further thing beside the members: another change in time of the same component."""
    return option.driver == TIME and any(o.driver == TIME and o.component == option.component for o in members)


def key_of(members: Sequence[Option]) -> frozenset[str]:
    return frozenset(o.label for o in members)


def add(sets: list[Members], new: Members) -> None:
    """Adds a set that is not there yet, in whatever order."""
    if not any(key_of(new) == key_of(other) for other in sets):
        sets.append(new)


def too_far(best: HypothesisFit, gained: float) -> bool:
    """Whether a set of MOST_MEMBERS would leave a misfit: ½ (χ² − its degrees of freedom) of the likeliest set, at
    PACE times what the last round `gained`."""
    left = 0.5 * (best.objective - best.projection.dof)
    return left > PACE * gained * (MOST_MEMBERS - len(best.options))


def tied(trial: HypothesisFit, places: Mapping[str, Effect]) -> Members:
    """Its members with one size in the place of several, where an effect acts at places of one kind; else none.
    `places`: label of each effect that may → the one that acts at all of them."""
    at: dict[str, list[Option]] = {}
    for o in trial.options:
        for e in o.hypothesis.effects:
            if o.kind == EFFECT and e.label in places:
                at.setdefault(places[e.label].label, []).append(o)
    several = next((own for own in at.values() if len(own) > 1), [])
    if not several:
        return ()
    others = (o for o in trial.options if all(o is not s for s in several))
    return (*others, effect_option(places[several[0].label]))
