"""The library of physics terms, by name, the effects of an engine that they make, and the parts that they look for.

A term is a class with a NAME in one of the family modules of `terms/`; nothing else lists it.

Several terms look for the same parts: their sites, and their state relative to the design point.
"""

from __future__ import annotations

import inspect
import pkgutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from enginediag_cli.drivers import DRIVERS
from enginediag_cli.engine.components.base import Component, scalar
from enginediag_cli.engine.components.combustion import Burner
from enginediag_cli.engine.components.passages import Ambient, Bleed, Duct, Splitter
from enginediag_cli.engine.components.turbomachinery import Compressor, Turbine
from enginediag_cli.engine.dual import Value, sqrt
from enginediag_cli.engine.evaluation import Evaluation, corrected_flow
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.term import Driver, Effect, Place, Site, Term
from enginediag_cli.physics import terms

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine


@cache
def _library() -> Mapping[str, Term]:
    """All terms by name, sorted. Families are imported when an engine or a search first names a term."""
    families = [import_module(f"{terms.__name__}.{m.name}") for m in pkgutil.iter_modules(terms.__path__)]
    classes = [c for module in families for c in vars(module).values() if _is_term(c, module.__name__)]
    found = {c.NAME: c() for c in classes}
    if len(found) < len(classes):
        names = [c.NAME for c in classes]
        raise TypeError(f"two terms have the NAME {next(n for n in names if names.count(n) > 1)!r}")
    return dict(sorted(found.items()))


def _is_term(c: Any, module: str) -> bool:
    """Whether an object of a module is a term that the module defines, and no base class of terms."""
    return inspect.isclass(c) and c.__module__ == module and issubclass(c, Term) and "NAME" in vars(c)


def term_names() -> tuple[str, ...]:
    """Names of all terms, sorted."""
    return tuple(_library())


def term(name: str) -> Term:
    """The term of that name. Raises KeyError."""
    return _library()[name]


def library_drivers() -> tuple[Driver, ...]:
    """Drivers that terms bring beside those that are listed."""
    named = (term(name).DRIVER for name in term_names())
    return tuple(dict.fromkeys(d for d in named if d not in DRIVERS))


def effect(engine: Engine, name: str, site: str, values: Mapping[str, float] | None = None) -> Effect:
    """The term of that name at a site of the engine. Raises KeyError with what is unknown."""
    found = term(name)
    sites = {s.name: s for s in found.sites(engine.network)}
    if site not in sites:
        raise KeyError(f"{name}@{site}")
    return Effect(found, sites[site], dict(values or {}), limits=coefficient_limits(engine))


def candidate_effects(engine: Engine, without: Sequence[str] = ()) -> Iterator[Effect]:
    """Every term that is sought, at every site of the engine that its model does not carry, absent.

    `without`: terms, or labels `term@site`, that are excluded.
    """
    carried = {e.label for e in engine.effects}
    for name in term_names():
        if name in without:
            continue
        found = term(name)
        for site in found.sites(engine.network) if found.SOUGHT else ():
            e = Effect(found, site, {}, limits=coefficient_limits(engine))
            if e.label not in carried and e.label not in without:
                yield e


def coefficient_limits(engine: Engine) -> Mapping[str, float]:
    """Upper bounds of coefficients that the engine's installation sets (`mismatch: limits:` of its file)."""
    block: Mapping[str, Any] = engine.declared.get("mismatch") or {}
    return dict(block.get("limits") or {})


class SharedTerm(Term):
    """The same term at the sites of `effects`, of one size, its only coefficient that is sought."""

    FROM_FILE = True

    def __init__(self, effects: Sequence[Effect]):
        term = effects[0].term
        self.effects, (self.size,) = tuple(effects), term.amplitudes()
        self.NAME, self.TITLE, self.DRIVER = term.NAME, term.TITLE, term.DRIVER
        self.STATEMENT, self.EQUATION, self.REFERENCE = term.STATEMENT, term.EQUATION, term.REFERENCE
        self.COEFFICIENTS, self.INPUTS = (self.size,), term.INPUTS

    def driver_words(self) -> str:
        return self.effects[0].term.driver_words()

    def sites(self, network: Network) -> Iterable[Site]:
        """One that stands for all of them."""
        own = [e.site for e in self.effects]
        acts_on = tuple(dict.fromkeys(leaf for s in own for leaf in s.targets))
        yield Site("+".join(s.name for s in own), own[0].component, acts_on)

    def install(self, at: Place) -> None:
        def size(e: Evaluation) -> Value:
            return at.c(e, self.size.name) - self.size.absent

        for effect in self.effects:
            at.install_sized(effect, size)


def shared_effects(effects: Iterable[Effect], network: Network) -> Mapping[str, Effect]:
    """Label of each effect that may act by one size at all places of its kind → the effect that does, absent."""
    parts = {c.name: type(c).__name__ for c in network.components}
    alike: dict[tuple[str, ...], list[Effect]] = {}
    for e in effects:
        if len(e.term.amplitudes()) == 1 and not e.trial_names and not e.term.INPUTS and not e.site.everywhere:
            # instruments and shafts are no parts of the gas path: those of one term are of one kind
            alike.setdefault((e.term.NAME, parts.get(e.site.component, "")), []).append(e)
    found: dict[str, Effect] = {}
    for own in alike.values():
        if len(own) > 1:
            term = SharedTerm(own)
            (site,) = term.sites(network)
            found |= dict.fromkeys((e.label for e in own), replace(own[0], term=term, site=site, values={}))
    return found


def separate_effects(effect: Effect) -> tuple[Effect, ...]:
    """An effect as an engine file states it: at each of its places, with its coefficients."""
    if not isinstance(effect.term, SharedTerm):
        return (effect,)
    return tuple(replace(e, values={**e.values, **effect.values}) for e in effect.term.effects)


Quantity = Callable[[Evaluation], Value]
"""A number of a point of the engine (N,): a relative corrected speed, a share of the flow, an angle."""


def component_sites(components: Iterable[Component], *quantities: str) -> Iterator[Site]:
    """A site at each component, where these of its leaves change."""
    for c in components:
        yield Site(c.name, c.name, tuple(f"{c.name}.{quantity}" for quantity in quantities))


def outlet_sites(components: Iterable[Component]) -> Iterator[Site]:
    """A site at each component, where the flow that it delivers changes."""
    for c in components:
        yield Site(c.name, c.name, (f"station {c.values['to']}",))


def compressors(network: Network) -> list[Compressor]:
    return [c for c in network.components if isinstance(c, Compressor)]


def turbines(network: Network) -> list[Turbine]:
    return [c for c in network.components if isinstance(c, Turbine)]


def burners(network: Network) -> list[Burner]:
    """Burners in the order of the gas path; every engine has one."""
    return [c for c in network.components if isinstance(c, Burner)]


def core_compressor(network: Network) -> list[Compressor]:
    """The last compressor of the gas path, the high-pressure compressor or the only one; empty without any."""
    return compressors(network)[-1:]


def has_variable_speed(network: Network, component: Component) -> bool:
    """Whether the component's shaft may turn at any speed, and not at one only."""
    return bool(network.shafts[component.values["shaft"]]["speed"] != "constant")


def upstream(network: Network, station: str) -> Component | None:
    """The component that delivers a station's gas; ducts and bleeds are looked through."""
    for c in network.components:
        delivers = ("core", "bypass") if isinstance(c, Splitter) else ("to",)
        if station in (c.values.get(k) for k in delivers):
            return upstream(network, c.values["from"]) if isinstance(c, (Duct, Bleed)) else c
    return None


def is_hot(network: Network, station: str) -> bool:
    """Whether the station's gas holds fuel."""
    assert network.design_point is not None
    return network.design_point.flows[station].mixture.far is not None


def flies(network: Network) -> bool:
    """Whether altitude and Mach number are recorded, rather than the air beside the machine."""
    return any(isinstance(c, Ambient) and c.values["conditions"] == "flight" for c in network.components)


def relative_speed(at: Place, shaft: str) -> Quantity:
    """N/N_design of a shaft."""
    reference = scalar(at.design.shafts[shaft].speed_rpm)
    return lambda e: e.shaft(shaft).speed_rpm * (1.0 / reference)


def relative_corrected_speed(at: Place) -> Quantity:
    """(N/√T)/(N/√T)_design of the site's compressor with T at its inlet."""
    station, shaft = at.component.values["from"], at.component.values["shaft"]
    inlet = at.design.flows[station]
    reference = scalar(at.design.shafts[shaft].speed_rpm) / scalar(inlet.T) ** 0.5
    return lambda e: e.shaft(shaft).speed_rpm / sqrt(e.flows[station].T) * (1.0 / reference)


def relative_flow(at: Place, station: str) -> Quantity:
    """x = (W√T/P)/(W√T/P)_design of a station."""
    reference = scalar(corrected_flow(at.design.flows[station]))
    return lambda e: corrected_flow(e.flows[station]) * (1.0 / reference)
