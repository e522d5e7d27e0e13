"""One effect at several places of one kind, by one size: all cooling ports, both nozzles, all compressors.

A search that names the same effect at two places has two sizes for what may be one. An engine file carries it as the
same effect stated at each of the places with equal coefficients (`each`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.term import Effect, Place, Site, Term


class Together(Term):
    """The same term at the sites of `effects`, of one size, its only coefficient that is sought."""

    OF_A_FILE = True

    def __init__(self, effects: Sequence[Effect]):
        term = effects[0].term
        self.effects, (self.size,) = tuple(effects), term.amplitudes()
        self.NAME, self.TITLE, self.DRIVER = term.NAME, term.TITLE, term.DRIVER
        self.STATEMENT, self.EQUATION, self.REFERENCE = term.STATEMENT, term.EQUATION, term.REFERENCE
        self.COEFFICIENTS, self.INPUTS = (self.size,), term.INPUTS

    def varies_with(self) -> str:
        return self.effects[0].term.varies_with()

    def sites(self, network: Network) -> Iterable[Site]:
        """One that stands for all of them."""
        own = [e.site for e in self.effects]
        acts_on = tuple(dict.fromkeys(leaf for s in own for leaf in s.acts_on))
        yield Site("+".join(s.name for s in own), own[0].component, acts_on)

    def install(self, at: Place) -> None:
        def size(e: Evaluation) -> Value:
            return at.c(e, self.size.name) - self.size.absent

        for effect in self.effects:
            at.sized(effect, size)


def kinds_of_places(effects: Iterable[Effect], network: Network) -> Mapping[str, Effect]:
    """Label of each effect that may act by one size at all places of its kind → the effect that does, absent."""
    parts = {c.name: type(c).__name__ for c in network.components}
    alike: dict[tuple[str, ...], list[Effect]] = {}
    for e in effects:
        if len(e.term.amplitudes()) == 1 and not e.tried and not e.term.INPUTS and not e.site.everywhere:
            # instruments and shafts are no parts of the gas path: those of one term are of one kind
            alike.setdefault((e.term.NAME, parts.get(e.site.component, "")), []).append(e)
    found: dict[str, Effect] = {}
    for own in alike.values():
        if len(own) > 1:
            term = Together(own)
            (site,) = term.sites(network)
            found |= dict.fromkeys((e.label for e in own), replace(own[0], term=term, site=site, values={}))
    return found


def each(effect: Effect) -> tuple[Effect, ...]:
    """An effect as an engine file states it: at each of its places, with its coefficients."""
    if not isinstance(effect.term, Together):
        return (effect,)
    return tuple(replace(e, values={**e.values, **effect.values}) for e in effect.term.effects)
