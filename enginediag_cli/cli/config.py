"""What every command does besides its own work, in one class: options from files and environment, log, lock, help.

An option's value is that of the command line, else of the environment (ENGINEDIAG_DETECT_FALSE_ALARM), else of
enginediag.yaml in the working folder, else the built-in default. Click looks in these places by itself; this module
reads the file, with the place of every value, before the command line is parsed:

    kind: defaults
    all: {log: runs.jsonl}
    detect: {nominal: nominal.yaml, false-alarm: 0.001, window: 10min}

A key is the long name of an option without its dashes. `all` holds for every command that has the option; a command's
own section goes before it.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import click
from click.core import ParameterSource

from enginediag_cli.cli.options import (
    FILE_OF_DEFAULTS,
    HEADINGS,
    OPERATION,
    AppendedFile,
    ConfigFile,
    FiniteRange,
    GroupedOption,
    OutputFile,
    check_outputs,
    has_value,
    is_default,
    long_name,
    message_options,
)
from enginediag_cli.errors import ConfigError, DataError, ExitCode, Mark, Problem
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from pathlib import Path

    from enginediag_cli.api.results import Result
    from enginediag_cli.config.document import Node
    from enginediag_cli.config.fields import Field, Section
    from enginediag_cli.config.validate import Checked
    from enginediag_cli.progress import Listener
    from enginediag_cli.report.output import Output

DEFAULTS = "enginediag.yaml"
"""The file of options in the working folder."""

KIND = "defaults"
ALL = "all"
"""Section of options for every command that has them."""

NO_SETTINGS = ("help", "print_config")
NOT_IN_FILES = (*NO_SETTINGS, "config")
"""Options that a file cannot give."""

WITHOUT_EFFECT = {
    *("log", "lock", "lock_wait", "config", "quiet", "color", "debug", "verbose", "allow_outside", "exit_code", "idle"),
    *("format", "no_header", "wide", "columns", "show", "processes", "jobs", "resume"),
}
"""Options on which no result depends: where and how it is shown, and how the work is done."""

MARKS = "enginediag.defaults"
"""Key of a context's `meta`: the place of each option that a file gives, by parameter."""

ONE_LINE = 1_000_000
"""Characters of a line of YAML: more than any value has."""


class FileDefaults(NamedTuple):
    """Options that a file gives to one command: values by parameter, as click takes defaults, and their places."""

    values: dict[str, Any]
    marks: dict[str, Mark]


class Command(click.Command):
    """A command with a log, a lock, options from files and environment, and help in groups. It is called with the run's
    `Messages` and the values of its options; it returns its `ExitCode`, or nothing for `DONE`."""

    def __init__(self, name: str | None, *, finding: str = "", **settings: Any):
        super().__init__(name, epilog=exit_codes(finding), **settings)
        self.adapters = getattr(self.callback, "adapters", [])
        reads_yaml = any(isinstance(p.type, ConfigFile) or p.name in ("nominal", "files") for p in self.params)
        self.params += [*message_options(), *operation_options(reads_yaml or _takes(self.params, "catalogue"))]

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """Open the log and read the file of options; then parse the command line, or print the configuration."""
        name = str(info_name)
        extra.setdefault("auto_envvar_prefix", f"ENGINEDIAG_{name.replace(' ', '_')}")
        if parent is not None and not parent.resilient_parsing:
            self._prepare(name, args, parent, extra)
            if "--print-config" in (args[: args.index("--")] if "--" in args else args):
                context = click.Context(self, info_name=name, parent=parent, **extra)
                typed, _, _ = self.make_parser(context).parse_args(list(args))
                click.echo(configuration(context, typed), nl=False)
                context.exit()
        return super().make_context(info_name, args, parent, **extra)

    def _prepare(self, name: str, args: list[str], parent: click.Context, extra: dict[str, Any]) -> None:
        """Open the log of a run and read the file of options, once. Raises DataError, ConfigError, BadParameter."""
        messages = parent.ensure_object(Messages)
        if messages.begun:  # a step of a demonstration
            return
        messages.begun = True
        ahead = click.Context(
            self, info_name=name, parent=parent, resilient_parsing=True, ignore_unknown_options=True, **extra
        )
        typed, _, _ = self.make_parser(ahead).parse_args(list(args))
        asked = self.get_help_option(ahead)
        if asked is not None and typed.get(str(asked.name)):
            return
        line = [*name.split(), *args]
        if not typed.get("print_config"):
            _open_log(messages, ahead, typed, line)
        path = _value_ahead(ahead, "config", typed)
        if path == "" or (path is None and not os.path.lexists(DEFAULTS)):
            return
        ahead.meta[FILE_OF_DEFAULTS] = DEFAULTS if path is None else path
        given = read_defaults(ahead.meta[FILE_OF_DEFAULTS], name, self, unnamed=path is None)
        extra["default_map"] = ahead.default_map = given.values
        ahead.meta[MARKS] = given.marks
        check_effective(given, click.Context(self, info_name=name, parent=parent, **extra), typed)
        if messages.log is None and not typed.get("print_config"):
            _open_log(messages, ahead, typed, line)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command once its inputs and outputs are known to differ: under its lock, with its progress shown."""
        from enginediag_cli.api.results import provenance_notes

        messages, values = ctx.ensure_object(Messages), dict(ctx.params)
        check_outputs(ctx)
        lock, wait = values.pop("lock"), values.pop("lock_wait")
        del values["log"], values["config"]
        chosen = choices_besides(ctx)
        if MARKS in ctx.meta and chosen:
            messages.note(f"options not of the command line: {', '.join(f'{k} {v}' for k, v in chosen.items())}")

        def run() -> Any:
            for adapt in self.adapters:
                adapt(values)
            return self.callback(messages, **values) if self.callback is not None else None

        notes = {f"option {word}": text for word, text in chosen.items()}
        with provenance_notes(notes), _locked(lock, wait, ctx, messages), _listened(messages):
            return ctx.invoke(run)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options under their headings; --help is one of operation."""
        options = [p for p in self.get_params(ctx) if isinstance(p, click.Option)]
        for heading in HEADINGS:
            under = [o for o in options if getattr(o, "heading", OPERATION) == heading]
            records = [record for option in under if (record := option.get_help_record(ctx)) is not None]
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)


def command(short_help: str = "", *, finding: str = "", cls: type[Command] = Command) -> Any:
    """`click.command`; `finding` is what exit code 1 means, where it can occur. The group has the short help of its
    commands itself."""
    return click.command(cls=cls, short_help=short_help, finding=finding)


def exit_codes(finding: str = "") -> str:
    """The exit codes, for the end of a command's help."""
    one = f"1 {finding}; " if finding else ""
    first = f"Exit codes: 0 done; {one}2 bad usage, configuration or data;"
    return f"\b\n{first}\n3 no verdict; 70 internal error; 75 --lock is held; 130 interrupted."


def operation_options(reads_yaml: bool) -> list[GroupedOption]:
    """Options of every command for its log, its lock and its configuration."""
    outside = GroupedOption(
        ["--allow-outside"],
        heading=OPERATION,
        is_flag=True,
        expose_value=False,
        callback=_allow_outside,
        help="Allow a YAML file to name files outside its own folder and the shipped ones.",
    )
    return [
        *([outside] if reads_yaml else []),
        GroupedOption(
            ["--config"],
            heading=OPERATION,
            for_all=True,
            metavar="FILE",
            type=click.Path(dir_okay=False),
            help=f"YAML file with defaults of options, instead of {DEFAULTS} in the working folder; '' for none.",
        ),
        GroupedOption(
            ["--log"],
            heading=OPERATION,
            for_all=True,
            metavar="FILE",
            type=AppendedFile(),
            help="Append all messages to FILE as JSON lines, with exit code, duration and the SHA-256 of each output. "
            "Several runs may share it.",
        ),
        GroupedOption(
            ["--lock"],
            heading=OPERATION,
            metavar="FILE",
            type=AppendedFile(),
            help="Run only if no other run holds this lock; otherwise exit with 75.",
        ),
        GroupedOption(
            ["--lock-wait"],
            heading=OPERATION,
            metavar="SECONDS",
            type=FiniteRange(min=0),
            default=0.0,
            show_default=True,
            help="Time to wait for --lock.",
        ),
        GroupedOption(
            ["--print-config"],
            heading=OPERATION,
            is_flag=True,
            expose_value=False,
            help="Print the value of every option and its source, as a file for --config, and exit.",
        ),
    ]


def _takes(params: Iterable[click.Parameter], name: str) -> bool:
    return any(parameter.name == name for parameter in params)


def _allow_outside(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    from enginediag_cli.config.files import READING

    before, READING.allow_outside = READING.allow_outside, bool(value)
    context.call_on_close(lambda: setattr(READING, "allow_outside", before))


def _open_log(messages: Messages, context: click.Context, typed: Mapping[str, Any], line: list[str]) -> None:
    path = _value_ahead(context, "log", typed)
    if path is not None:
        from enginediag_cli.report.messages import RunLog

        messages.log = RunLog(path, line[0])
        messages.log.begin(line)


def _value_ahead(context: click.Context, name: str, typed: Mapping[str, Any]) -> Any:
    """The value of one option before click comes to it; None when it is not given."""
    parameter = next(p for p in context.command.params if p.name == name)
    value, _ = parameter.consume_value(context, typed)
    return parameter.type_cast_value(context, value) if has_value(value) else None


@contextmanager
def _locked(path: str | None, wait: float, context: click.Context, messages: Messages) -> Iterator[None]:
    """Hold the lock of the run, if there is one. Raises LockedError, DataError."""
    if path is None:
        yield
        return
    from enginediag_cli.parallel import lock_file

    with lock_file(path, str(context.info_name), wait):
        messages.record("note", f"holds {path}", lock=os.path.abspath(path))
        yield


@contextmanager
def _listened(messages: Messages) -> Iterator[None]:
    """Show the progress of the run, and log it."""
    from time import monotonic

    from enginediag_cli.progress import listening

    shown, since = messages.listener(), monotonic()
    listener: Listener | None = shown
    if messages.log is not None and not messages.log.heard:
        from enginediag_cli.report.messages import LogListener

        messages.log.heard = True
        listener = LogListener(messages.log, shown)
    if listener is None:
        yield
        return
    try:
        with listening(listener):
            yield
    finally:
        if shown is not None:
            shown.total(since)


# -- how a command ends


def write_result(result: Result, output: Output, picture: str | None = None) -> None:
    """Write the rows as they come; they are kept for a picture only."""
    rows = iter(result.rows) if picture else None
    head = result.provenance  # computes the first row, which opens the first file: an error leaves no output behind
    output.write_rows(
        rows or result.stream(), result.columns, summary=result.summary_columns, provenance=head, live=True
    )
    if picture:
        result.plot().save(picture)


def choose_exit_code(found: int, judged: int, exit_code: bool, unread: Collection[str] = ()) -> ExitCode:
    """Exit code: a finding on request only; trouble for unread files; no verdict when nothing could be judged."""
    if found and exit_code:
        return ExitCode.FINDING
    if unread:
        return ExitCode.TROUBLE
    return ExitCode.DONE if judged else ExitCode.NO_VERDICT


# -- the file of options


def settable_options(command: click.Command) -> dict[str, click.Option]:
    """The options of a command that a file may give, by their names in it."""
    found = [p for p in command.params if isinstance(p, click.Option) and p.name not in NOT_IN_FILES]
    return {long_name(option): option for option in found}


def every_command() -> dict[str, click.Command]:
    """All commands with their options; imports their modules."""
    from enginediag_cli.cli.main import COMMANDS, enginediag

    group = click.Context(enginediag)
    found = {name: enginediag.get_command(group, name) for name in COMMANDS}
    return {name: command for name, command in found.items() if command is not None}


def defaults_section(known: Mapping[str, click.Command], others: Iterable[str] = ()) -> Section:
    """The declaration of a file: the options of the `known` commands; of `others` only that there may be a section."""
    from enginediag_cli.config.fields import Field, Section

    common: dict[str, Field] = {}
    fields = []
    for name, command in known.items():
        own = [_make_field(word, option) for word, option in settable_options(command).items()]
        help = (command.short_help or "").rstrip(".")
        fields.append(Field(name, "section", help, default=None, section=Section(name, help, tuple(own))))
        for field in own:
            common[field.name] = _common_field(common[field.name], field) if field.name in common else field
    every = Section(ALL, "options of every command that has them", tuple(common.values()))
    return Section(
        KIND,
        "defaults of the options of commands",
        (
            Field("kind", "choice", "kind of this file", choices=(KIND,)),
            Field(ALL, "section", every.help, default=None, section=every),
            *fields,
            *(Field(name, "section", "", default=None, section=Section(name, "", ())) for name in others),
        ),
    )


def _make_field(word: str, option: click.Option) -> Field:
    """An option as a key. Bounds that a value must not reach are left to the option itself."""
    from enginediag_cli.config.fields import Field

    help, kind = (option.help or "").rstrip("."), option.type
    if option.multiple or option.nargs != 1:
        return Field(word, "texts", help, default=None)
    if option.is_flag:
        return Field(word, "boolean", help, default=None)
    if isinstance(kind, click.IntRange | click.FloatRange):
        whole = "integer" if isinstance(kind, click.IntRange) else "number"
        return Field(word, whole, help, default=None, minimum=kind.min, maximum=kind.max)
    if isinstance(kind, click.Choice):
        return Field(word, "choice", help, default=None, choices=tuple(map(str, kind.choices)))
    return Field(word, "scalar", help, default=None)


def _common_field(one: Field, other: Field) -> Field:
    """The key under `all` of an option that two commands have, which each will check by itself."""
    from dataclasses import replace

    from enginediag_cli.config.fields import Field

    if one.kind != other.kind:
        return Field(one.name, "scalar", one.help, default=None)
    if (one.choices, one.minimum, one.maximum) == (other.choices, other.minimum, other.maximum):
        return one
    return replace(one, kind="scalar" if one.kind == "choice" else one.kind, choices=(), minimum=None, maximum=None)


def read_defaults(path: str, name: str, command: click.Command, *, unnamed: bool) -> FileDefaults:
    """What a file gives to a command. unnamed: it lies in the working folder and nobody named it, so that what it names
    to be written must lie there, too. Raises ConfigError."""
    from dataclasses import replace

    from enginediag_cli.cli.main import COMMANDS
    from enginediag_cli.config.document import load_document
    from enginediag_cli.config.validate import require_kind, validate

    document = load_document(path)
    require_kind(document, KIND)
    known: Mapping[str, click.Command] = {name: command}
    if document.is_mapping and any(word not in settable_options(command) for word in _keys(document.value.get(ALL))):
        known = every_command()
    others = [other for other in COMMANDS if other not in known]
    if document.is_mapping:  # sections of other commands are not checked now
        kept = {key: node for key, node in document.value.items() if key not in others}
        document = replace(document, value=kept)
    return _read_section_values(validate(document, defaults_section(known, others)), command, name, unnamed)


def _keys(section: Node | None) -> tuple[str, ...]:
    return tuple(section.value) if section is not None and section.is_mapping else ()


def check_effective(given: FileDefaults, context: click.Context, typed: Mapping[str, Any]) -> None:
    """Check the file's values of options that neither command line nor environment overrides. Raises ConfigError."""
    problems: list[Problem] = []
    for option in context.command.params:
        if option.name in given.marks and option.consume_value(context, typed)[1] is ParameterSource.DEFAULT_MAP:
            problems += _refusals(option, given, context)
    if problems:
        raise ConfigError(sorted(problems, key=lambda problem: problem.mark))


def check_defaults(path: Path) -> None:
    """Check what a file gives to every command. Raises ConfigError."""
    from enginediag_cli.config.document import load_document
    from enginediag_cli.config.validate import validate

    commands = every_command()
    checked = validate(load_document(path), defaults_section(commands))
    problems: list[Problem] = []
    for name, command in commands.items():
        given = _read_section_values(checked, command, name, False)
        context = click.Context(command, info_name=name)
        for option in command.params:
            problems += _refusals(option, given, context)
    if problems:
        raise ConfigError(sorted(set(problems), key=lambda problem: problem.mark))


def _read_section_values(checked: Checked, command: click.Command, name: str, unnamed: bool) -> FileDefaults:
    options, folder = settable_options(command), os.path.dirname(checked.file)
    given = FileDefaults({}, {})
    problems: list[Problem] = []
    for section in (ALL, name):
        for word, value in (checked.values.get(section) or {}).items():
            option = options.get(word)
            if option is None or value is None:
                continue
            mark, value = checked.mark((section, word)), _converted(value, option, folder)
            if unnamed and _reaches_out(value, option, folder):
                what = f"{section}.{word} is not allowed in a file that nobody named"
                problems.append(Problem(mark, what, f"name it: --config {checked.file}"))
            given.values[str(option.name)], given.marks[str(option.name)] = value, mark
    if problems:
        raise ConfigError(problems)
    return given


def _converted(value: Any, option: click.Option, folder: str) -> Any:
    """A value as click takes it from a mapping of defaults: relative paths are those beside the file."""
    if option.nargs != 1:
        return [item.split() for item in value]
    if not isinstance(option.type, click.Path):
        return value
    return (
        [_resolve_path(item, option, folder) for item in value]
        if option.multiple
        else _resolve_path(value, option, folder)
    )


def _resolve_path(path: str, option: click.Option, folder: str) -> str:
    if path in ("", "-") or os.path.isabs(path) or not folder:
        return path
    joined = os.path.join(folder, path)
    if isinstance(option.type, ConfigFile) and not os.path.lexists(joined):
        from enginediag_cli.shipped import shipped

        try:
            return str(shipped(path))
        except DataError:
            return joined
    return joined


def _reaches_out(value: Any, option: click.Option, folder: str) -> bool:
    """Whether a file outside the folder would be written, or the folder's fence be taken down: what comes with
    recordings of somebody else must not do so."""
    if option.name == "allow_outside":
        return bool(value)
    if not isinstance(option.type, OutputFile) or value == "-":
        return False
    inside, path = os.path.realpath(folder or "."), os.path.realpath(value)
    return os.path.commonpath([inside, path]) != inside


def _refusals(option: click.Parameter, given: FileDefaults, context: click.Context) -> Iterator[Problem]:
    """What an option has against its value in the file."""
    name = str(option.name)
    if name not in given.marks:
        return
    try:
        value = option.type_cast_value(context, given.values[name])
        if option.callback is not None and option.expose_value:  # the others keep what they are given
            option.callback(context, option, value)
    except click.BadParameter as error:
        yield Problem(given.marks[name], f"{long_name(option)}: {error.message.rstrip('.')}")
    except click.UsageError as error:
        yield Problem(given.marks[name], f"{long_name(option)}: {error.message}")


def __getattr__(name: str) -> Section:
    """DEFAULTS_FILE, the declaration of all commands, made when it is asked for."""
    if name == "DEFAULTS_FILE":
        return defaults_section(every_command())
    raise AttributeError(name)


# -- what holds, and where it comes from


def choices_besides(context: click.Context) -> dict[str, str]:
    """Options on which the result depends and that a file or the environment gives: value and source, by name."""
    sources = {ParameterSource.ENVIRONMENT: "environment", ParameterSource.DEFAULT_MAP: "file"}
    found = {}
    for parameter in context.command.params:
        name = str(parameter.name)
        source = sources.get(context.get_parameter_source(name) or ParameterSource.DEFAULT)
        value = context.params.get(name)
        if source is None or name in WITHOUT_EFFECT or isinstance(parameter.type, OutputFile):
            continue
        if is_default(context, parameter, value):
            continue
        if source == "file" and MARKS in context.meta:
            source = os.path.basename(context.meta[MARKS][name].file)
        each = value if isinstance(value, (list, tuple)) else [value]
        if isinstance(parameter.type, click.Path):
            each = [os.path.basename(str(item)) for item in each]
        words = (" ".join(map(str, item)) if isinstance(item, tuple) else str(item) for item in each)
        found[long_name(parameter)] = f"{' '.join(words)} ({source})"
    return found


def configuration(context: click.Context, typed: Mapping[str, Any]) -> str:
    """Every option of a command with its value and, as a comment, its source: as a file that gives the same. An option
    without a value is a comment. Raises click.UsageError for a value that is wrong."""
    from enginediag_cli.config.document import dump

    command, name = context.command, context.info_name
    lines = [f"# the options of enginediag {name}, and where each comes from", f"kind: {KIND}", f"{name}:"]
    for parameter in command.get_params(context):
        option = isinstance(parameter, click.Option)
        if parameter.name in NO_SETTINGS or parameter is command.get_help_option(context):
            continue
        value, source = parameter.consume_value(context, typed)
        value = parameter.type_cast_value(context, value if has_value(value) else None)
        word = long_name(parameter) if option else (parameter.metavar or str(parameter.name))
        if parameter.nargs not in (1, -1) and value:
            value = [" ".join(map(str, item)) for item in value]
        line = dump({word: _plain(value)}, width=ONE_LINE).rstrip("\n")
        line = line[1:-1] if line.startswith("{") else line  # a mapping of one scalar comes in braces
        if value is None or value == ():
            lines.append(f"  # {word}:  # not given")
        else:
            mark = "" if option and parameter.name not in NOT_IN_FILES else "# "
            lines.append(f"  {mark}{line}  # {_source(parameter, source, context)}")
    return "\n".join(lines) + "\n"


def _source(parameter: click.Parameter, source: ParameterSource | None, context: click.Context) -> str:
    if source is ParameterSource.ENVIRONMENT and isinstance(parameter, GroupedOption):
        return "environment, " + next((name for name in parameter.variables(context) if os.environ.get(name)), "")
    if source is ParameterSource.DEFAULT_MAP:
        return str(context.meta[MARKS][parameter.name])
    return "command line" if source is ParameterSource.COMMANDLINE else "default"


def _plain(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value if isinstance(value, (bool, int, float, str)) or value is None else str(value)
