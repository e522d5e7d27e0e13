"""Names in words: what a parameter is called stands in the parameter; other names are spelt as people write them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from enginediag_cli.parameters import Parameter, meanings, spelled

__all__ = ["listed", "maintained", "spelled", "told"]


def told(known: Mapping[str, Parameter], names: Iterable[str]) -> list[str]:
    """The parameters of these names as an engineer says them; one that is not known keeps its name."""
    return [p.words for p in meanings(known, names).values()]


def maintained(kind: str, component: str) -> str:
    """Maintenance in words: "exchange turbine"; of the whole engine its kind."""
    return f"{kind} {component}".strip()


def listed(items: list[str] | tuple[str, ...], last: str = "and") -> str:
    """ "a", "a and b", "a, b and c"."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} {last} {items[-1]}"
