"""Effects whose size a law may give: where the engine itself has no parameter, air that leaves, power that is taken.

The effect acts with the size absent + f; a law at a size that the engine file carries, too, is a further effect of the
kind. Effects that remember, and those of several sizes, are none of these.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from enginediag_cli.engine.moving.tape import MOMENT
from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.physics.laws.law import Acts
from enginediag_cli.physics.laws.variables import Variable
from enginediag_cli.physics.registry import term, term_names

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


def levers(network: Network) -> dict[str, Effect]:
    """By the name of their size, all that can act on the engine, absent."""
    found = {}
    for known in map(term, term_names()):
        if MOMENT in known.INPUTS or known.TRIALS:
            continue
        for site in known.sites(network):
            effect = Effect(known, site, {})
            if len(effect.sizes) == 1:
                found[effect.sizes[0]] = effect
    return found


def at_lever(effect: Effect) -> Acts:
    """Where a law acts that gives the size of this effect."""
    return Acts(effect.sizes[0], effect.site.component, size_of(effect).unit, False, through=effect)


def size_of(effect: Effect) -> Coefficient:
    """The one coefficient without which the effect is absent."""
    return next(c for c in effect.term.amplitudes() if not c.free)


def varies_itself(acts: Acts, variable: Variable) -> bool:
    """Whether a law there would vary with the very input that it changes."""
    return variable.recorded and acts.through is not None and any(c in acts.site.acts_on for c in variable.columns)
