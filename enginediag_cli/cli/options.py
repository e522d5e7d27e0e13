"""Options of commands: each is declared once and stands under a heading of the help.

    @command(finding="a change was found and --exit-code given")
    @recordings_options
    @window_options
    @output_options
    def detect(messages, nominal, source, output, **choices): ...

The name of a parameter is that of its option, so that click finds its default in the environment
(ENGINEDIAG_DETECT_FALSE_ALARM) and in a file. A group of options may replace its values by one argument (`options`).

Types of values: finite numbers, lengths of windows, YAML files to read, and files to write, which must not be one of
those that are read.
"""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, TypeVar

import click

from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from enginediag_cli.report.output import Output


FILE_OF_DEFAULTS = "enginediag.defaults.file"
"""Key of a context's `meta`: the file of options that was read."""

TABLE_SUFFIXES = ("", ".txt", ".dat", ".csv", ".json", ".ndjson", ".jsonl", ".parquet")
"""Endings, besides .gz behind all but .parquet, under which a table can be written; see `Output.chosen_format`."""

CSV_SUFFIXES = ("", ".txt", ".dat", ".csv", ".parquet")
"""Those of tables of columns alone."""

PICTURE_SUFFIXES = ("", ".svg", ".png")
LENGTH = re.compile(r"\s*\d+(\.\d+)?\s*(s|min|h|)\s*")
"""A number of records, or a time."""


class FiniteRange(click.FloatRange):
    """A range of finite numbers: click compares, and nan passes every comparison."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Refuse nan and infinity, too."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number", param, ctx)
        return number


POSITIVE = FiniteRange(min=0, min_open=True)
COUNT = click.IntRange(min=1)


class Length(click.ParamType):
    """A number of records, or a time, as text."""

    name = "length"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Refuse what is neither."""
        if not LENGTH.fullmatch(str(value)):
            self.fail(f"{value!r} is not a number of records (60) or a time (300s, 10min, 1h)", param, ctx)
        return value


class RequiredChange(click.ParamType):
    """PATTERN=SIZE, a shell pattern of parameters and a positive change in their unit; or `none`, which is None."""

    name = "required_change"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Split the text."""
        if value == "none" or isinstance(value, tuple):
            return value
        pattern, _, size = str(value).rpartition("=")
        try:
            number = float(size)
        except ValueError:
            number = math.nan
        if not pattern or not (math.isfinite(number) and number > 0.0):
            self.fail(
                f"{value!r} is not PATTERN=SIZE with a positive size, such as '*.efficiency=0.02', or none", param, ctx
            )
        return pattern, number


class ConfigFile(click.Path):
    """A YAML file that exists. A name that is not in the working folder may be that of a shipped file, such as
    turbofan.yaml or faults/hpc_fouling.yaml."""

    def __init__(self) -> None:
        super().__init__(exists=True, dir_okay=False, readable=True)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Find the file."""
        if isinstance(value, str) and not os.path.lexists(value):
            from enginediag_cli.errors import DataError
            from enginediag_cli.shipped import own_or_shipped

            try:
                value = str(own_or_shipped(value))
            except DataError as error:
                self.fail(str(error), param, ctx)
        return super().convert(value, param, ctx)


EXISTING = click.Path(exists=True, dir_okay=False, readable=True)
"""A file that can be read."""


class OutputFile(click.Path):
    """A file to write. It is refused before the work, not after: its folder must exist, and its ending must be one of
    `suffixes` (none: any) unless `--format` chooses. `-` is standard output."""

    def __init__(self, suffixes: tuple[str, ...] = ()) -> None:
        super().__init__(dir_okay=False, allow_dash=True)
        self.suffixes = suffixes

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Refuse a path that cannot be written."""
        path = os.fspath(value)
        if path == "-":
            if sys.stdout is None or not sys.stdout.writable():
                self.fail("standard output is closed; name a file", param, ctx)
            return path
        folder = os.path.dirname(os.path.abspath(path))
        if not path or os.path.isdir(path) or not os.path.isdir(folder):
            reason = "is a folder" if os.path.isdir(path) else f"there is no folder {folder}"
            self.fail(f"{path or repr(path)}: {reason if path else 'not a file name'}", param, ctx)
        return path

    def check_suffix(self, path: str, param: click.Parameter, ctx: click.Context) -> None:
        """Fail for an ending that this option does not write."""
        suffix = os.path.splitext(path.lower().removesuffix(".gz"))[1]
        if self.suffixes and path != "-" and not path.startswith("/dev/") and suffix not in self.suffixes:
            known = ", ".join(s for s in self.suffixes if s)
            more = "; or choose with --format" if "format" in ctx.params else ""
            self.fail(f"{path}: {suffix} files are not written; possible are {known}{more}", param, ctx)
        if suffix not in self.suffixes or suffix not in (".parquet", ".png"):
            return
        kind, others = ("Parquet", " (.csv, .json, .ndjson)") if suffix == ".parquet" else ("PNG", "")
        if path.lower().endswith(".gz"):
            self.fail(f"{path}: a {kind} file is compressed already; leave out .gz{others}", param, ctx)
        if suffix == ".parquet":
            from enginediag_cli.report.output import check_parquet

            check_parquet(path)
        else:
            from enginediag_cli.report.plotting.svg import png_library

            png_library(path)


class AppendedFile(OutputFile):
    """A file that is not replaced: `-` is none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Refuse standard output."""
        if value == "-":
            self.fail("standard output is for data; name a file", param, ctx)
        return super().convert(value, param, ctx)


def check_outputs(context: click.Context) -> None:
    """Refuse an output that is an input of the same command, by whatever path, or that is named twice, and one whose
    ending promises another format. Raises click.BadParameter."""
    inputs = list(_inputs(context))
    written: list[tuple[str, str]] = []
    for parameter in context.command.params:
        value = context.params.get(parameter.name or "")
        if not isinstance(parameter.type, OutputFile) or not isinstance(value, str):
            continue
        for what, path in inputs:
            if _is_same_file(value, path):
                raise click.BadParameter(f"{value} is also an input ({what}); it would be lost", context, parameter)
        for what, path in written:
            if value != "-" and os.path.realpath(value) == os.path.realpath(path):
                raise click.BadParameter(f"{value} is also the file of {what}", context, parameter)
        written.append((max(parameter.opts, key=len), value))
        if context.params.get("format", "auto") == "auto" or parameter.name != "output":
            parameter.type.check_suffix(value, parameter, context)


def _inputs(context: click.Context) -> Iterator[tuple[str, str]]:
    """(how it was given, path) of each file that is to be read; "-" is standard input."""
    if FILE_OF_DEFAULTS in context.meta:
        yield "options", context.meta[FILE_OF_DEFAULTS]
    for parameter in context.command.params:
        if not isinstance(parameter.type, click.Path) or isinstance(parameter.type, OutputFile):
            continue
        value = context.params.get(parameter.name or "")
        what = max(parameter.opts, key=len) if isinstance(parameter, click.Option) else parameter.human_readable_name
        for path in value if isinstance(value, (list, tuple)) else [value]:
            if not isinstance(path, str):
                continue
            yield what, path
            if os.path.isdir(path):  # a folder of fault files
                yield from ((what, entry.path) for entry in os.scandir(path) if entry.is_file())


def _is_same_file(output: str, file: str) -> bool:
    """Whether an output is an input: the same regular file, as path, link, or redirected standard stream."""
    import stat

    try:
        out = os.fstat(sys.stdout.fileno()) if output == "-" else os.stat(output)
        read = os.fstat(sys.stdin.fileno()) if file == "-" else os.stat(file)
    except (OSError, ValueError, AttributeError):  # not there yet, closed, or no real stream
        return False
    return stat.S_ISREG(out.st_mode) and os.path.samestat(out, read)


Function = TypeVar("Function", bound=Callable[..., Any])
Decorator = Callable[[Any], Any]
Values = dict[str, Any]

INPUT, MODEL, JUDGEMENT, OUTPUT, OPERATION = HEADINGS = ("Input", "Model", "Judgement", "Output", "Operation")
"""Headings of the help of a command, in this order."""

PREFIX = "ENGINEDIAG"
"""Of the environment variables that hold defaults."""

FORMATS = ("auto", "csv", "json", "ndjson", "table")


class GroupedOption(click.Option):
    """An option under one of HEADINGS. `for_all`: ENGINEDIAG_<OPTION> holds a default for every command, too."""

    def __init__(self, *names: Any, heading: str, for_all: bool = False, **settings: Any):
        super().__init__(*names, **settings)
        self.heading, self.for_all = heading, for_all

    def variables(self, context: click.Context) -> list[str]:
        """Environment variables that hold its default; the first that is set is used."""
        prefixes = [context.auto_envvar_prefix] if context.auto_envvar_prefix else []
        return [f"{prefix}_{str(self.name).upper()}" for prefix in [*prefixes, *([PREFIX] if self.for_all else [])]]

    def resolve_envvar_value(self, ctx: click.Context) -> str | None:
        """Read the default from the environment."""
        return super().resolve_envvar_value(ctx) or next(filter(None, map(os.environ.get, self.variables(ctx))), None)


def option(heading: str, *names: str, **settings: Any) -> Decorator:
    """`click.option` under a heading."""
    return click.option(*names, cls=GroupedOption, heading=heading, **settings)


def options(*declared: Decorator, adapt: Callable[[Values], None] | None = None) -> Decorator:
    """Combine options to one decorator; `adapt` may replace their values by what the command takes."""

    def decorate(function: Any) -> Any:
        for one in reversed(declared):
            function = one(function)
        if adapt is not None:
            function.__dict__.setdefault("adapters", []).append(adapt)
        return function

    return decorate


def long_name(parameter: click.Parameter) -> str:
    """The long name of an option without its dashes."""
    return max(parameter.opts, key=len).lstrip("-")


def has_value(value: object) -> bool:
    """Whether there is a value; click has had two ways to say that there is none."""
    return value is not None and type(value).__name__ != "Sentinel"


def is_default(context: click.Context, parameter: click.Parameter, value: object) -> bool:
    """Whether a value is the built-in default."""
    if not has_value(parameter.default):
        a_choice = value is False and bool(parameter.secondary_opts)
        return not a_choice and value in (None, False, ())
    return bool(parameter.type_cast_value(context, parameter.default) == value)


def is_chosen(context: click.Context, name: str) -> bool:
    """Whether the user has chosen an option's value, wherever; a file that repeats the default chooses nothing."""
    from click.core import ParameterSource

    source = context.get_parameter_source(name)
    if source is not ParameterSource.DEFAULT_MAP:
        return source is not None and source is not ParameterSource.DEFAULT
    parameter = next(p for p in context.command.params if p.name == name)
    return not is_default(context, parameter, context.params.get(name))


# -- operation: what every command has


def _set_message(context: click.Context, parameter: click.Parameter, value: Any) -> None:
    if value and parameter.name:  # an option of the group stays set when its command leaves it out
        setattr(context.ensure_object(Messages), parameter.name, value)


def message_options() -> list[GroupedOption]:
    """`-q`, `-v`, `--color` and `--debug`: kept in the run's `Messages`, not passed to the command."""
    kept: dict[str, Any] = {"expose_value": False, "is_eager": True, "callback": _set_message, "heading": OPERATION}
    return [
        GroupedOption(["-q", "--quiet"], is_flag=True, help="Print only errors on standard error.", **kept),
        GroupedOption(
            ["-v", "--verbose"],
            is_flag=True,
            help="Print on standard error which files are read and written, and the time of each stage.",
            **kept,
        ),
        GroupedOption(
            ["--color"],
            type=click.Choice(["auto", "always", "never"]),
            default=None,
            help="Colours; auto follows the terminal and NO_COLOR.",
            **kept,
        ),
        GroupedOption(["--debug"], is_flag=True, help="Print the traceback of an error.", **kept),
    ]


exit_code_option = option(OPERATION, "--exit-code", is_flag=True, help="Exit with 1 if there is a finding.")
"""Opt-in, because a 1 from the middle of a pipe would stop a script under `set -o pipefail`."""

seed_option = option(
    OPERATION,
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    metavar="N",
    help="Seed of all random numbers. The same seed gives the same bytes.",
)


def _start_jobs(values: Values) -> None:
    from enginediag_cli.parallel import CAN_FORK, use_processes

    jobs, context = values.pop("jobs"), click.get_current_context()
    if jobs > 1 and not CAN_FORK:
        context.ensure_object(Messages).note("--jobs has no effect: this system cannot fork a process")
    context.with_resource(use_processes(jobs))


jobs_option = options(
    option(
        OPERATION,
        "--jobs",
        metavar="N",
        type=COUNT,
        default=1,
        show_default=True,
        help="Number of processes. The result does not depend on it.",
    ),
    adapt=_start_jobs,
)

all_cores_option = option(
    OPERATION,
    "--jobs",
    metavar="N",
    type=COUNT,
    help="Number of processes. Default: one per core. The result does not depend on it.",
)


# -- input and model


def _input_files(context: click.Context, parameter: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
    files = value or ("-",)
    if files.count("-") > 1:
        raise click.UsageError("standard input (-) can be read only once", context)
    nothing_is_piped = sys.stdin is None or sys.stdin.closed or sys.stdin.isatty()
    if "-" in files and not context.resilient_parsing and nothing_is_piped:
        raise click.UsageError("no input: name a FILE, or pipe data in", context)
    return files


def _open_recordings(values: Values) -> None:
    from enginediag_cli.api.inputs import Recordings

    names = ("recordings", "recorder", "engine_instance", "accept_mismatch")
    values["source"] = Recordings(*(values.pop(name) for name in names))


engine_argument = click.argument("engine", metavar="ENGINE.yaml", type=ConfigFile())
accept_mismatch_option = option(
    INPUT,
    "--accept-mismatch",
    is_flag=True,
    help="Continue although the recordings cannot be of this engine or in these units.",
)
recorder_options = options(
    option(
        INPUT,
        "--recorder",
        metavar="FILE",
        type=ConfigFile(),
        help="Recorder file (YAML): columns and units of foreign recordings.",
    ),
    option(
        INPUT, "--engine-instance", default="", metavar="NAME", help="Use only the records of this engine (or side)."
    ),
)
recordings_argument = click.argument(
    # what does not exist, or is no file, is reported when it is read: the other files are judged
    "recordings",
    nargs=-1,
    metavar="[FILE]...",
    callback=_input_files,
    type=click.Path(allow_dash=True),
)
recordings_options = options(recordings_argument, recorder_options, accept_mismatch_option, adapt=_open_recordings)
"""Recordings and how they are read, as one `source: Recordings`."""


def nominal_options(help: str = "Nominal file of the engine, from identify.", *, required: bool = False) -> Decorator:
    """`--nominal FILE` and `--accept-changed-engine`."""
    return options(
        option(MODEL, "-n", "--nominal", required=required, metavar="FILE", type=EXISTING, help=help),
        option(
            MODEL,
            "--accept-changed-engine",
            is_flag=True,
            help="Use the engine file although it has changed since the identification.",
        ),
    )


model_error_option = option(
    MODEL,
    "--model-error",
    metavar="SHARE",
    type=FiniteRange(0, 0.1),
    help="Relative accuracy of the component maps, such as 0.003. A deviation within it is no finding. Default: the "
    "value of the nominal file, else of the engine file. 0 means exact maps.",
)


def _mark_choices(values: Values) -> None:
    context = click.get_current_context()
    values["chosen"] = {name: is_chosen(context, name) for name in context.params}


comparison_options = options(
    option(
        MODEL,
        "--monitor",
        metavar="PATTERN",
        multiple=True,
        help="Parameters that may have changed, by name or shell pattern, such as 'hpc.*' or sensor.T3.bias. "
        "Repeatable. Default: those that the engine file monitors.",
    ),
    option(
        MODEL,
        "--linearise",
        type=click.Choice(["estimate", "nominal"]),
        default="estimate",
        show_default=True,
        help="Linearise the model at the estimate for each window, or at the nominal state (small changes only).",
    ),
    model_error_option,
    option(
        JUDGEMENT,
        "--reference",
        metavar="N",
        type=click.IntRange(min=0),
        default=0,
        help="Take the first N records of each flight and engine as healthy, and judge the rest relative to them.",
    ),
    option(
        JUDGEMENT,
        "--last",
        metavar="N",
        type=click.IntRange(min=0),
        default=0,
        help="Judge only the last N records of each flight and engine.",
    ),
    adapt=_mark_choices,
)
"""How recordings are compared with the nominal engine: attributes of `WindowOptions`, with which of them are set."""

window_option = option(
    JUDGEMENT,
    "--window",
    metavar="LENGTH",
    type=Length(),
    help="Length of a window: records (60) or time (300s, 10min, 1h). Default: each flight is one window.",
)
window_options = options(
    comparison_options,
    window_option,
    option(
        JUDGEMENT,
        "--step",
        metavar="LENGTH",
        type=Length(),
        help="From the start of a window to the start of the next. Default: the length of a window.",
    ),
)


def probability_option(name: str, default: float, help: str, heading: str = JUDGEMENT) -> Decorator:
    """An option that is a probability, neither 0 nor 1."""
    inside = FiniteRange(0, 1, min_open=True, max_open=True)
    return option(heading, name, metavar="P", type=inside, default=default, show_default=True, help=help)


false_alarm_option = probability_option("--false-alarm", 0.01, "False-alarm rate of the test.")


def by_option(component: str) -> Decorator:
    """--by; component: what its rows are."""
    kinds = click.Choice(["parameter", "component"])
    return option(OUTPUT, "--by", type=kinds, default="parameter", show_default=True, help=component)


def _collect_margin(values: Values) -> None:
    from enginediag_cli.api.trends import MarginOptions

    limit, consumed, removed, at = (values.pop(name) for name in ("limit", "consumed_limit", "taken_off", "at"))
    if sum(map(bool, (limit, consumed, removed))) > 1:
        raise click.UsageError("--limit, --consumed-limit and --taken-off exclude each other")
    margin = MarginOptions({}, consumed, removed, values.pop("events") or "", values.pop("baseline"), {}, dict(at))
    values["margin"] = margin.add_limits(dict(limit))


def _stated_inputs(
    context: click.Context, parameter: click.Parameter, value: tuple[str, ...]
) -> tuple[tuple[str, float], ...]:
    """COLUMN=VALUE, each once."""
    found: dict[str, float] = {}
    for text in value:
        column, _, number = text.partition("=")
        try:
            found[column.strip()] = float(number)
        except ValueError:
            raise click.BadParameter(f"{text!r} is not COLUMN=VALUE, such as mach=0.2", context, parameter) from None
    return tuple(found.items())


margin_options = options(
    option(
        JUDGEMENT,
        "--limit",
        nargs=2,
        type=(str, POSITIVE),
        metavar="COLUMN VALUE",
        multiple=True,
        help="Limit in the unit of the column: of a turbine temperature, such as T45_K 1280, to which the EGT margin "
        "is counted; also of a speed, a torque or a power. Power or thrust available is that at the first limit. "
        "Repeatable.",
    ),
    option(
        JUDGEMENT,
        "--at",
        metavar="COLUMN=VALUE",
        multiple=True,
        callback=_stated_inputs,
        help="Input of the condition at which the margin and the power available are computed, such as altitude_m=1500 "
        "or the power setting; the others stay. Default: rating on a standard hot day, sea level, at rest, ISA + 15 K. "
        "Repeatable.",
    ),
    option(
        JUDGEMENT,
        "--consumed-limit",
        nargs=2,
        type=POSITIVE,
        metavar="KELVIN KELVIN",
        help="Without a known limit: EGT margin used when an engine is removed, and its standard deviation, such as "
        "25 3.",
    ),
    option(
        JUDGEMENT,
        "--taken-off",
        metavar="ENGINE",
        multiple=True,
        help="Engine that was removed worn at the end of its recordings. Three or more give the limit of the others. "
        "Repeatable.",
    ),
    option(
        INPUT,
        "--events",
        metavar="FILE",
        type=EXISTING,
        help="CSV of maintenance: columns kind (wash, overhaul, exchange), flight (the first after it) or time_s, "
        "component, and engine (optional for one engine).",
    ),
    option(
        JUDGEMENT,
        "--baseline",
        metavar="FLIGHTS",
        type=click.IntRange(min=0),
        default=0,
        help="First flights of an engine, taken as healthy: the EGT margin used is counted from them. Default: those "
        "of --reference, else the first flight.",
    ),
    adapt=_collect_margin,
)
"""From and to what the EGT margin is counted, as one `margin: MarginOptions`."""


# -- output


def _column_names(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(name.strip() for name in (value or "").split(",") if name.strip()))
    if value is not None and not names:
        raise click.BadParameter("name at least one column", context, parameter)
    return names


def _open_output(values: Values) -> None:
    from enginediag_cli.report.output import Output

    messages = click.get_current_context().ensure_object(Messages)
    path, form, bare, wide, columns = (
        values.pop(name) for name in ("output", "format", "no_header", "wide", "columns")
    )
    values["output"] = Output(path, form, not bare, messages.color, wide, columns, messages.note)


def output_file_option(
    help: str, suffixes: tuple[str, ...] = (), *, required: bool = False, metavar: str = "FILE"
) -> Decorator:
    """`-o/--output FILE`; standard output when not given, unless it is required."""
    absent: dict[str, Any] = {} if required else {"default": "-"}  # to click from 8.3 on, None is a value, too
    return option(
        OUTPUT, "-o", "--output", required=required, metavar=metavar, type=OutputFile(suffixes), help=help, **absent
    )


output_options = options(
    output_file_option("Write to FILE, completely or not at all; - is standard output.", TABLE_SUFFIXES),
    option(
        OUTPUT,
        "-f",
        "--format",
        type=click.Choice(FORMATS),
        default="auto",
        help="auto follows the ending of FILE (.csv, .json, .ndjson, .parquet); without one: table on a terminal, csv "
        "in a pipe. ndjson is one object per line.",
    ),
    option(OUTPUT, "--no-header", is_flag=True, help="Omit the # lines with the provenance."),
    option(OUTPUT, "--wide", is_flag=True, help="Show all columns on a terminal."),
    option(OUTPUT, "--columns", metavar="A,B", callback=_column_names, help="Only these columns, in this order."),
    adapt=_open_output,
)
"""Where and how rows are written, as one `output: Output`."""


def picture_option(what: str) -> Decorator:
    """`--picture FILE`."""
    return option(
        OUTPUT,
        "--picture",
        metavar="FILE.svg|png",
        type=OutputFile(PICTURE_SUFFIXES),
        help=f"Draw {what} into FILE (.png needs the extra enginediag[report]).",
    )


work_scope_option = option(
    OUTPUT,
    "--work-scope/--no-work-scope",
    default=None,
    help="Report by how much restoring each named module lowers turbine temperature and fuel flow at equal thrust or "
    "power. Default: in sentences and JSON; --work-scope adds a column to tables and CSV.",
)


def extra_form(choice: bool | None, output: Output, *, with_wide: bool = False) -> str:
    """How an addition to an answer is written: "nested" objects in JSON, a "cell" of text, "sentences" alone, or ""."""
    if choice is False:
        return ""
    if output.chosen_format() in ("json", "ndjson"):
        return "nested"
    return "cell" if choice or (with_wide and output.wide) else "sentences"


def complete_terms(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the name of a physical effect."""
    from enginediag_cli.api.discrepancy import effect_names

    return completions(dict.fromkeys(effect_names(), ""), incomplete)


def completions(known: dict[str, str], incomplete: str) -> list[CompletionItem]:
    """Those of the known names, each with its help, that begin as what has been typed."""
    from click.shell_completion import CompletionItem

    return [CompletionItem(name, help=help or None) for name, help in known.items() if name.startswith(incomplete)]
