"""Finds physics terms by name: the term `reynolds_efficiency` is the one class of `terms/reynolds_efficiency.py`.

To add an effect, write its file; nothing else lists it.

One effect at several places of one kind, by one size: all cooling ports, both nozzles, all compressors.

A search that names the same effect at two places has two sizes for what may be one. An engine file carries it as the
same effect stated at each of the places with equal coefficients (`each`).
"""

from __future__ import annotations

import inspect
import pkgutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from enginediag_cli.drivers import DRIVERS
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.term import Driver, Effect, Place, Site, Term
from enginediag_cli.physics import terms

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine


def term_names() -> tuple[str, ...]:
    """Names of all terms, sorted; no term is imported."""
    return tuple(sorted(m.name for m in pkgutil.iter_modules(terms.__path__)))


@cache
def term(name: str) -> Term:
    """The term of that name. Raises KeyError."""
    if name not in term_names():
        raise KeyError(name)
    module = import_module(f"{terms.__name__}.{name}")
    found = [
        c
        for _, c in inspect.getmembers(module, inspect.isclass)
        # its module first: to Python 3.10 tuple[str, ...] is a class, of builtins, of which nothing is a subclass
        if c.__module__ == module.__name__ and issubclass(c, Term) and getattr(c, "NAME", None) == name
    ]
    if len(found) != 1:
        raise TypeError(f"{module.__name__} must hold exactly one Term with NAME {name!r}")
    return found[0]()


def own_drivers() -> tuple[Driver, ...]:
    """Drivers that terms bring beside those that are listed."""
    named = (term(name).DRIVER for name in term_names())
    return tuple(dict.fromkeys(d for d in named if d not in DRIVERS))


def effect(engine: Engine, name: str, site: str, values: Mapping[str, float] | None = None) -> Effect:
    """The term of that name at a site of the engine. Raises KeyError with what is unknown."""
    found = term(name)
    sites = {s.name: s for s in found.sites(engine.network)}
    if site not in sites:
        raise KeyError(f"{name}@{site}")
    return Effect(found, sites[site], dict(values or {}), limits=limits(engine))


def candidates(engine: Engine, without: Sequence[str] = ()) -> Iterator[Effect]:
    """Every term that is sought, at every site of the engine that its model does not carry, absent.

    `without`: terms, or labels `term@site`, that are left out.
    """
    carried = {e.label for e in engine.effects}
    for name in term_names():
        if name in without:
            continue
        found = term(name)
        for site in found.sites(engine.network) if found.SOUGHT else ():
            e = Effect(found, site, {}, limits=limits(engine))
            if e.label not in carried and e.label not in without:
                yield e


def limits(engine: Engine) -> Mapping[str, float]:
    """Upper bounds of coefficients that the engine's installation sets (`mismatch: limits:` of its file)."""
    block: Mapping[str, Any] = engine.declared.get("mismatch") or {}
    return dict(block.get("limits") or {})


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
