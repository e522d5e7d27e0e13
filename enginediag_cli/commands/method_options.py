"""`detect --method`: another method's verdict on each window, in place of the tool's own."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import wraps
from itertools import chain
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from enginediag_cli.commands.operation import is_chosen
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from enginediag_cli.errors import ExitCode
    from enginediag_cli.methods.base import FittedMethod, Method
    from enginediag_cli.methods.on_recordings import WindowVerdict
    from enginediag_cli.residuals.files import JudgedFiles

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
        from enginediag_cli.config.hints import near
        from enginediag_cli.methods.registry import METHODS

        if value not in METHODS:
            self.fail(f"there is no method {value!r} ({near(value, METHODS)})", param, ctx)
        return value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        from enginediag_cli.methods.registry import METHODS

        return [CompletionItem(n, help=m.HELP) for n, m in METHODS.items() if n.startswith(incomplete)]


@dataclass(frozen=True)
class Rival:
    """The method asked for by name, empty for the tool's own; recordings believed healthy to learn from; the nominal
    file beside them."""

    name: str = ""
    healthy: tuple[str, ...] = ()
    nominal: str = ""

    def __bool__(self) -> bool:
        return bool(self.name)

    def chosen(self, linearise: str) -> Method:
        """The method with its choices."""
        from enginediag_cli.methods.registry import METHODS

        return METHODS[self.name].with_options({"linearise": linearise})

    def check(self, method: Method, nominal: str | None, recordings: Sequence[str]) -> None:
        """Raises click.UsageError for options that do not go together."""
        context = click.get_current_context()
        refused = {
            f"--{option.replace('_', '-')}": why
            for option, why in NOT_WITH_A_METHOD.items()
            if is_chosen(context, option)
        }
        typed = context.get_parameter_source("linearise") is ParameterSource.COMMANDLINE
        if typed and all(f.name != "linearise" for f in method.OPTIONS):
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
        nominal = click.get_current_context().params.get("nominal")
        return function(*args, rival=Rival(method or "", healthy, str(nominal or "")), **others)

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


def detect_by_method(
    messages: Messages,
    rival: Rival,
    files: JudgedFiles,
    false_alarm: float,
    exit_code: bool,
    output: Output,
) -> ExitCode:
    """A row per window of the recordings among the files."""
    from collections import Counter
    from dataclasses import replace

    from enginediag_cli.commands.judging import ending, open_intake, tell_files
    from enginediag_cli.methods.on_recordings import judged_windows, learnt_windows, recorded_windows
    from enginediag_cli.presentation.left_out import tell_left_out
    from enginediag_cli.presentation.method_rows import method_row
    from enginediag_cli.presentation.outputs.detect import BY_METHOD
    from enginediag_cli.recordings.provenance import header_lines
    from enginediag_cli.residuals.gross_gate import GrossErrorGate

    monitor, intake, plan = files.monitor, files.intake, files.judging.plan
    assert monitor is not None
    method, healthy = rival.chosen(files.judging.linearise), None
    if method.learns:
        learnt = open_intake(replace(intake.source, files=rival.healthy), monitor)
        gate = GrossErrorGate(monitor)
        healthy = learnt_windows(monitor, gate.clean(learnt.chunks()), plan)
        gate.report(learnt.left_out)
        tell_left_out(messages, learnt.left_out)
    fitted: FittedMethod = method.train(monitor, healthy)
    tally: Counter[str] = Counter()
    judged = GrossErrorGate(monitor)

    def rows() -> Iterator[dict[str, Any]]:
        found: WindowVerdict
        recordings = judged.clean(intake.chunks())
        for found in judged_windows(fitted, recorded_windows(monitor, recordings, plan), false_alarm):
            tally[found.verdict] += 1
            place = found.window.place
            files.counts.update(outside=place.outside, incomplete=place.incomplete)
            files.elsewhere.update(place.elsewhere)
            yield method_row(found, method)
        judged.report(intake.left_out)

    every = rows()
    first = next(every, None)
    head = header_lines(
        "detect",
        configs=[rival.nominal, *intake.source.configs, *rival.healthy],
        notes={**BY_METHOD.notes, "method": method.name, "false_alarm": str(false_alarm), **intake.source.notes},
        inherited=intake.provenance,
    )
    output.write_rows(chain([first] if first is not None else [], every), provenance=head, live=True)
    tell_files(messages, files)
    messages.note(", ".join(f"{n} {what}" for what, n in sorted(tally.items())) or "no window", counts=dict(tally))
    return ending(tally["fault"], sum(tally.values()) - tally["no verdict"], exit_code, files.intake.unread)
