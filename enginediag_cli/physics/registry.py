"""Finds physics terms by name: the term `reynolds_efficiency` is the one class of `terms/reynolds_efficiency.py`.

To add an effect, write its file; nothing else lists it.
"""

from __future__ import annotations

import inspect
import pkgutil
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from enginediag_cli.drivers import DRIVERS
from enginediag_cli.engine.driver import Driver
from enginediag_cli.engine.term import Effect, Term
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
