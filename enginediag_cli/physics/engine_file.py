"""An engine file → Engine, with the effects of the library that the file lists under `physics:`.

The `physics:` block of an engine file: its entries as effects at their sites.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from enginediag_cli.config.hints import near
from enginediag_cli.config.validate import Checked
from enginediag_cli.engine.term import Effect
from enginediag_cli.errors import Problem
from enginediag_cli.physics.laws.declared import law_effect
from enginediag_cli.physics.registry import term, term_names

if TYPE_CHECKING:
    from enginediag_cli.engine.description import EngineDescription
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.engine.network import Network


def load_engine(path: str | Path | EngineDescription, power_setting: str | None = None) -> Engine:
    """Reads, checks and sizes an engine, from its file or a description that travels in another file; `power_setting`
    replaces the file's. Raises ConfigError."""
    from enginediag_cli.engine.load import build_engine

    return build_engine(path, carried_effects, power_setting)


def carried_effects(
    blocks: Sequence[Mapping[str, Any]], network: Network, checked: Checked
) -> tuple[list[Effect], list[Problem]]:
    """The effects of the blocks, and everything that is wrong with them at its place in the file."""
    effects: list[Effect] = []
    problems: list[Problem] = []
    for k, block in enumerate(blocks):
        at = ("physics", k)
        if "law" in block:
            effect, told = law_effect(block, at, checked, network)
            problems += told
            if effect is not None:
                problems += _twice(effect, effects, at, checked)
                effects.append(effect)
            continue
        if block["term"] not in term_names():
            problems.append(
                Problem(
                    checked.mark((*at, "term")),
                    f"there is no physics term '{block['term']}'",
                    near(block["term"], term_names()),
                )
            )
            continue
        found = term(block["term"])
        sites = {s.name: s for s in found.sites(network)}
        if block["at"] not in sites:
            problems.append(
                Problem(
                    checked.mark((*at, "at")), f"{found.NAME} cannot act at '{block['at']}'", near(block["at"], sites)
                )
            )
            continue
        problems += _coefficient_problems(found.COEFFICIENTS, block, at, checked)
        effect = Effect(found, sites[block["at"]], dict(block["coefficients"]), block["switch"])
        problems += _twice(effect, effects, at, checked)
        effects.append(effect)
    return ([] if problems else effects), problems


def _twice(effect: Effect, before: Sequence[Effect], at: tuple[str | int, ...], checked: Checked) -> list[Problem]:
    return [Problem(checked.mark(at), f"{effect.label} is listed twice") for e in before if e.label == effect.label]


def _coefficient_problems(
    known: Sequence[Any], block: Mapping[str, Any], at: tuple[str | int, ...], checked: Checked
) -> list[Problem]:
    by_name = {c.name: c for c in known}
    problems = []
    for key in ("coefficients", "standard_errors"):
        for name in block[key]:
            if name not in by_name:
                problems.append(
                    Problem(
                        checked.mark((*at, key, name)),
                        f"{block['term']} has no coefficient '{name}'",
                        near(name, by_name),
                    )
                )
    for name, value in block["coefficients"].items():
        c = by_name.get(name)
        if c is not None and not c.lower <= value <= c.upper:
            problems.append(
                Problem(
                    checked.mark((*at, "coefficients", name)),
                    f"{name} is {value:g}, outside its physical bounds",
                    f"{c.lower:g} to {c.upper:g}",
                )
            )
    return problems
