"""Engine file → `Engine` with the effects that the file lists under `physics:`.

An entry is either a term of the library with its coefficients, or a `law:`, an effect that a formula states. Every
problem of an entry is reported at its place. `law_entry` writes a law as the entry that `read_law` reads.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.config.fields import near
from enginediag_cli.config.validate import Checked
from enginediag_cli.engine.dual import value
from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.errors import Problem
from enginediag_cli.parameters import Parameter
from enginediag_cli.physics.law import (
    FUNCTIONS,
    MEMORY_FUNCTIONS,
    Expression,
    ExpressionError,
    Law,
    LawPlace,
    Variable,
    adjustable_effects,
    changes_variable,
    effect_place,
    format_unit,
    formula_variables,
    parse_unit,
)
from enginediag_cli.physics.registry import term, term_names
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.engine.load import EngineDescription
    from enginediag_cli.engine.network import Network


NOTHING = 1e-9
"""Of a law's size: what counts as zero."""
TRIED, FROM, TO = 16, 0.5, 1.5
"""Points, and the range of their variables over the design point's, where a law whose coefficients are absent must be
nothing."""


@dataclass(frozen=True)
class _Entry:
    """One entry, its place in the file, and what of the engine it may name."""

    block: Mapping[str, Any]
    at: tuple[str | int, ...]
    checked: Checked
    network: Network

    def problem(self, message: str, hint: str = "", *key: str | int) -> Problem:
        return Problem(self.checked.mark((*self.at, *key)), message, hint)


def read_law(
    block: Mapping[str, Any], at: tuple[str | int, ...], checked: Checked, network: Network
) -> tuple[Effect | None, list[Problem]]:
    """The law of an entry at its place of the engine; None, and everything that is wrong with it."""
    entry = _Entry(block, at, checked, network)
    acts, problems = _acts(entry)
    coefficients = _coefficients(block["coefficients"])
    problems += _coefficient_problems(entry)
    variables = formula_variables(network)
    try:
        expression = Expression.parse(block["expression"])
        problems += _name_problems(entry, expression, variables)
        if acts is None or problems:
            return None, problems
        units = {n: parse_unit("1") for n in variables} | {
            n: parse_unit(c["unit"]) for n, c in block["coefficients"].items()
        }
        unit, wanted = expression.unit(units), parse_unit("1" if acts.factor else acts.unit)
    except ExpressionError as error:
        return None, [*problems, entry.problem(f"{error} (letter {error.column + 1})", "", "expression")]
    if unit != wanted:
        message = f"the formula is in {format_unit(unit)}, and what is added at {acts.leaf} in {format_unit(wanted)}"
        return None, [entry.problem(message, "give its coefficients such units", "expression")]
    changed = [n for n in sorted(expression.names) if n in variables and changes_variable(acts, variables[n])]
    if changed:
        return None, [entry.problem(f"'{changed[0]}' is what a law at {acts.leaf} changes", "", "expression")]
    law = Law(block["law"], acts, expression, variables, coefficients, block["statement"], block["source"])
    values = {n: c["value"] for n, c in block["coefficients"].items()}
    problems += _nothing_problems(entry, law, values)
    effect = Effect(law, acts.site, values, block["switch"])
    return (None if problems else effect), problems


def _acts(entry: _Entry) -> tuple[LawPlace | None, list[Problem]]:
    """Where it acts: a parameter of the engine, the reading of a sensor, or the size of an effect."""
    place, network = entry.block["at"], entry.network
    known: dict[str, Parameter] = {p.name: p for p in network.parameters() if p.family != "physics"}
    known |= {p.name: p for s in network.sensors.values() for p in s.parameters()}
    if place in known:
        p = known[place]
        factor = p.nominal == 1.0 and p.unit in ("", "1")
        return LawPlace(place, p.component, p.unit, factor), []
    if place in network.sensors:
        sensor = network.sensors[place]
        unit = split_column(place)[1] or "1"
        return LawPlace(place, f"sensor.{sensor.quantity}", unit, False, reading=True), []
    sizes = adjustable_effects(network)
    if place in sizes:
        return effect_place(sizes[place]), []
    message = (
        f"a law acts at a parameter or a recorded reading of the engine, or at the size of an effect; '{place}' is none"
    )
    return None, [entry.problem(message, near(place, [*known, *network.sensors, *sizes]), "at")]


def _coefficients(declared: Mapping[str, Mapping[str, Any]]) -> tuple[Coefficient, ...]:
    """Those with a value at which the law is absent are its sizes; others are free, or kept if they have no prior."""
    found = []
    for name, c in declared.items():
        size = c["absent"] is not None
        absent = c["absent"] if size else c["value"]
        sigma = c["prior_sigma"] or 0.0
        low, high = _bounds(c)
        free, kept = not size and sigma > 0.0, not size and sigma == 0.0
        found.append(
            Coefficient(
                name,
                c["unit"],
                c["description"] or f"coefficient {name}",
                absent=absent,
                lower=low,
                upper=high,
                sigma=sigma or max(abs(c["value"]), 1.0),
                typical=c["value"] or sigma,
                shape=kept,
                free=free,
            )
        )
    return tuple(found)


def _bounds(coefficient: Mapping[str, Any]) -> tuple[float, float]:
    """As declared; none is infinite."""
    low, high = coefficient["lower"], coefficient["upper"]
    return -np.inf if low is None else low, np.inf if high is None else high


def _coefficient_problems(entry: _Entry) -> list[Problem]:
    problems = []
    declared = entry.block["coefficients"]
    for name, c in declared.items():
        low, high = _bounds(c)
        for key in ("value", "absent"):
            if c[key] is not None and not low <= c[key] <= high:
                message = f"{name}: {key} is {c[key]:g}, outside its bounds {low:g} to {high:g}"
                problems.append(entry.problem(message, "", "coefficients", name, key))
        if c["absent"] is not None and not c["prior_sigma"]:
            message = f"{name} has a value at which the law is absent, and no prior_sigma: how large may it be?"
            problems.append(entry.problem(message, "", "coefficients", name))
    if not any(c["absent"] is not None for c in declared.values()):
        message = "no coefficient says `absent`: the value at which the law is not there"
        problems.append(entry.problem(message, "", "coefficients"))
    return problems


def _name_problems(entry: _Entry, expression: Expression, variables: Mapping[str, Variable]) -> Iterator[Problem]:
    declared = entry.block["coefficients"]
    for name in sorted(expression.names):
        if name not in variables and name not in declared:
            message = f"'{name}' is no variable of this engine and no coefficient of the law"
            yield entry.problem(message, near(name, [*variables, *declared]), "expression")
    for follower in expression.memory_calls:
        at = f"(letter {follower.column + 1})"
        if not follower.variables & set(variables):
            yield entry.problem(f"{follower.name} follows no variable {at}", "", "expression")
        for name in follower.coefficients:
            if name in variables:
                message = f"{follower.name} goes by coefficients, and '{name}' is a variable {at}"
                yield entry.problem(message, "", "expression")
    for name in declared:
        if name in variables or name in FUNCTIONS or name in MEMORY_FUNCTIONS:
            yield entry.problem(f"'{name}' is the name of something else in formulas", "", "coefficients", name)
        elif name not in expression.names:
            yield entry.problem(f"the formula does not have '{name}'", "", "coefficients", name)


def _nothing_problems(entry: _Entry, law: Law, values: Mapping[str, float]) -> Iterator[Problem]:
    """A law is nothing at the design point, where the engine is what its file says, and with absent coefficients."""
    f = law.expression
    reference = {n: v.reference for n, v in law.variables.items()}
    with np.errstate(all="ignore"):
        there = float(value(f.evaluate({**reference, **values})))
        draws = np.random.default_rng(0).uniform(FROM, TO, (len(reference), TRIED))
        at = {n: draws[k] if law.variables[n].recorded else draws[k] * r for k, (n, r) in enumerate(reference.items())}
        absent = {c.name: c.absent for c in law.COEFFICIENTS}
        left = np.broadcast_to(np.asarray(value(f.evaluate({**at, **absent}))), (TRIED,))
        sizes = np.abs(np.asarray(value(f.evaluate({**at, **values}))))
        size = float(np.max(sizes, where=np.isfinite(sizes), initial=0.0))
    if not np.isfinite(there):
        message = "the law has no finite value at the design point, where it must be 0: a pole, 0/0, or a root of less"
        yield entry.problem(message, ", ".join(f"{n} = {r:g}" for n, r in reference.items()), "expression")
    elif abs(there) > NOTHING * max(size, NOTHING):
        message = f"the law is {there:g} at the design point, where it must be 0"
        hint = ", ".join(f"{n} = {r:g}" for n, r in reference.items())
        yield entry.problem(message, f"there {hint}" if hint else "", "expression")
    if not (np.abs(left) <= NOTHING * max(size, NOTHING)).all():
        message = "the law is not 0 where its coefficients have the values at which it is absent"
        yield entry.problem(message, "", "expression")


DIGITS, ERROR_DIGITS = 6, 3
"""Significant digits of values, and of standard errors."""


def law_entry(effect: Effect, errors: Mapping[str, float] | None = None, source: str = "") -> dict[str, Any]:
    """The entry of an effect whose term is a law, with its values; `errors`: standard errors by parameter name.

    Raises TypeError for any other effect.
    """
    law = effect.term
    if not isinstance(law, Law):
        raise TypeError(f"{effect.label} is no law")
    block: dict[str, Any] = {"law": law.NAME, "at": law.acts.leaf, "expression": law.expression.text}
    known = errors or {}
    block["coefficients"] = {
        c.name: _coefficient(c, effect.values.get(c.name, c.absent), known.get(effect.parameter_name(c.name)))
        for c in law.COEFFICIENTS
    }
    block["statement"] = law.STATEMENT
    if effect.switch:
        block["switch"] = effect.switch
    if source:
        block["source"] = source
    return block


def _coefficient(c: Coefficient, value: float, error: float | None) -> dict[str, Any]:
    block: dict[str, Any] = {"value": _short(value)}
    if c.unit != "1":
        block["unit"] = c.unit
    if np.isfinite(c.lower):
        block["lower"] = _short(c.lower)
    if np.isfinite(c.upper):
        block["upper"] = _short(c.upper)
    if not c.free and not c.shape:
        block["absent"] = _short(c.absent)
    if not c.shape:
        block["prior_sigma"] = _short(c.sigma)
    if error is not None:
        block["standard_error"] = _short(error, ERROR_DIGITS)
    if c.description:
        block["description"] = c.description
    return block


def _short(value: float, digits: int = DIGITS) -> float:
    return float(f"{value:.{digits}g}")


def load_engine(path: str | Path | EngineDescription, power_setting: str | None = None) -> Engine:
    """Read, check and size an engine, with the effects that its file lists.

    Parameters
    ----------
    path
        An engine file, or the description of one that was stored in another file.
    power_setting
        Column that sets the power, in the place of the file's.

    Returns
    -------
    Engine
        The engine at nominal parameters.

    Raises
    ------
    ConfigError
        For anything wrong in the file, with its line and column.
    """
    from enginediag_cli.engine.load import build_engine

    return build_engine(path, read_effects, power_setting)


def read_effects(
    blocks: Sequence[Mapping[str, Any]], network: Network, checked: Checked
) -> tuple[list[Effect], list[Problem]]:
    """The effects of the blocks, and everything that is wrong with them at its place in the file."""
    effects: list[Effect] = []
    problems: list[Problem] = []
    for k, block in enumerate(blocks):
        at = ("physics", k)
        if "law" in block:
            effect, message = read_law(block, at, checked, network)
            problems += message
            if effect is not None:
                problems += _duplicates(effect, effects, at, checked)
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
        problems += _term_problems(found.COEFFICIENTS, block, at, checked)
        effect = Effect(found, sites[block["at"]], dict(block["coefficients"]), block["switch"])
        problems += _duplicates(effect, effects, at, checked)
        effects.append(effect)
    return ([] if problems else effects), problems


def _duplicates(effect: Effect, before: Sequence[Effect], at: tuple[str | int, ...], checked: Checked) -> list[Problem]:
    return [Problem(checked.mark(at), f"{effect.label} is listed twice") for e in before if e.label == effect.label]


def _term_problems(
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
    for name, x in block["coefficients"].items():
        c = by_name.get(name)
        if c is not None and not c.lower <= x <= c.upper:
            problems.append(
                Problem(
                    checked.mark((*at, "coefficients", name)),
                    f"{name} is {x:g}, outside its physical bounds",
                    f"{c.lower:g} to {c.upper:g}",
                )
            )
    return problems
