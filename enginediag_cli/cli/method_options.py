"""`detect --method`: another method's verdict on each window, in place of the tool's own."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from enginediag_cli.cli.operation import is_chosen

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

NOT_WITH_A_METHOD = {
    "follow": "it judges windows that are complete",
    "idle": "it judges windows that are complete",
    "detectable": "the smallest change is that of the tool's own test",
    "power": "the smallest change is that of the tool's own test",
    "must_show": "the smallest change is that of the tool's own test",
    "reference": "it compares with nominal, or with what it learns from --healthy",
    "last": "it judges whole recordings",
}
"""Options of detect that only its own test can honour, and why."""


class MethodName(click.ParamType):
    """The name of a method; the methods are only loaded when one is asked for."""

    name = "method"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        from enginediag_cli.api.detection import chosen_method
        from enginediag_cli.errors import UsageError

        try:
            chosen_method(value)
        except UsageError as error:
            self.fail(str(error), param, ctx)
        return value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        from enginediag_cli.api.detection import method_names

        return [CompletionItem(n, help=line) for n, line in method_names().items() if n.startswith(incomplete)]


@dataclass(frozen=True)
class Rival:
    """The method asked for by name, empty for the tool's own; recordings believed healthy to learn from."""

    name: str = ""
    healthy: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.name)

    def check(self, nominal: str | None, recordings: Sequence[str]) -> None:
        """Raises click.UsageError for options that do not go together."""
        from enginediag_cli.api.detection import chosen_method

        method = chosen_method(self.name)
        context = click.get_current_context()
        refused = {
            f"--{option.replace('_', '-')}": why
            for option, why in NOT_WITH_A_METHOD.items()
            if is_chosen(context, option)
        }
        typed = context.get_parameter_source("linearise") is ParameterSource.COMMANDLINE
        if typed and all(f.name != "linearise" for f in method.options):
            refused["--linearise"] = "it has no such choice"
        reasons = [f"{option} does not go with --method {self.name}: {why}" for option, why in refused.items()]
        if nominal is None:
            reasons.append(f"--method {self.name} needs --nominal")
        if method.learns and not self.healthy:
            reasons.append(f"--method {self.name} learns: name recordings believed healthy with --healthy FILE")
        if self.healthy and not method.learns:
            reasons.append(f"--healthy does not go with --method {self.name}: it learns nothing")
        files = [file for file in recordings if file != "-"]
        both = [file for file in files if any(os.path.samefile(file, other) for other in self.healthy)]
        reasons += [
            f"{file} is to be judged and to be learnt from: a method that has learnt it calls it healthy"
            for file in both
        ]
        if reasons:
            raise click.UsageError("; ".join(reasons))


def method_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--method`, `--healthy` as one `rival: Rival`."""

    @wraps(function)
    def with_rival(*args: Any, method: str | None, healthy: tuple[str, ...], **others: Any) -> Any:
        if healthy and not method:
            raise click.UsageError("--healthy goes with a --method that learns")
        return function(*args, rival=Rival(method or "", healthy), **others)

    name = click.option(
        "--method",
        metavar="NAME",
        type=MethodName(),
        help="Judge by another method, such as parity, extended_kalman, pca_raw or incremental: those that a study "
        "compares. The tool's own when not given.",
    )
    learnt = click.option(
        "--healthy",
        metavar="FILE",
        multiple=True,
        type=click.Path(exists=True, dir_okay=False, readable=True),
        help="With a --method that learns: recordings believed healthy; may be given several times.",
    )
    return name(learnt(with_rival))
