"""What is told of an answer beside itself: what would flip it, and what restoring the modules that it names brings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any

import click

from enginediag_cli.report.output import Output


@dataclass(frozen=True)
class Beside:
    """Choices of `beside_options`, None where nothing was said: then they are told in sentences and in json, in full,
    while tables and CSV, which hold a cell of text, wait to be asked. `flips`: with --wide, too."""

    flips: bool | None = None
    work_scope: bool | None = None

    def forms(self, output: Output) -> dict[str, str]:
        """How each is written into rows: "", "cell" or "nested"."""
        nested = output.chosen_format() in ("json", "ndjson")
        asked = {"flips": self.flips, "work_scope": self.work_scope}
        form = "nested" if nested else "cell"
        wide = {"flips": output.wide}
        return {
            name: form if choice is not False and (choice or nested or wide.get(name)) else ""
            for name, choice in asked.items()
        }

    def arguments(self, output: Output) -> dict[str, Any]:
        """The choices as arguments of the library: how each stands in rows, or is said in sentences alone."""
        unwanted = {"flips": self.flips is False, "work_scope": self.work_scope is False}
        return {name: form or ("" if unwanted[name] else "sentences") for name, form in self.forms(output).items()}


def work_scope_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """The option --work-scope."""
    return click.option(
        "--work-scope/--no-work-scope",
        default=None,
        help="Say what restoring each module that is named would bring: turbine temperature and fuel at equal thrust "
        "or power. In sentences and in json where neither is given; --work-scope: in tables and CSV, too.",
    )(function)


def beside_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """The options of `Beside`, as one argument `beside`."""

    @wraps(function)
    def with_beside(*args: Any, flips: bool | None, work_scope: bool | None, **others: Any) -> Any:
        return function(*args, beside=Beside(flips, work_scope), **others)

    return click.option(
        "--flips/--no-flips",
        default=None,
        help="Say what would change the first name: the smallest error of a map, a sensor or an input, or change of "
        "the prior. In sentences and in json where neither is given; --flips or --wide: in tables and CSV, too.",
    )(work_scope_option(with_beside))
