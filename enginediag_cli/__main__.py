"""Entry of the console script: run a command and turn every ending into one exit code.

Click ends with 1 on a broken pipe, on Ctrl-C and on many errors, and Python ends with 1 on an uncaught exception. Here
1 means "a fault was found", so every ending is mapped in `_report` and nowhere else.
"""

from __future__ import annotations

import errno
import io
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from enginediag_cli.errors import ConfigError, EngineDiagError, ExitCode

if TYPE_CHECKING:
    from enginediag_cli.report.messages import Messages


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `enginediag` with `arguments` (default: those of the shell) and return the exit code."""
    if arguments is None:
        _leave_no_half_written_file_when_terminated()
        _open_closed_streams()
        _write_utf_8()
        _use_one_thread()
        arguments = sys.argv[1:]
    try:
        from enginediag_cli.report.messages import Messages
    except KeyboardInterrupt:
        return ExitCode.INTERRUPTED
    messages = Messages()
    try:
        code = _run(arguments, messages)
        if sys.stdout is not None:
            sys.stdout.flush()
    except (Exception, KeyboardInterrupt, SystemExit) as error:
        code = _report(error, messages)
        _discard_unwritable_output()
    messages.finish(code)
    return code


def _use_one_thread() -> None:
    """Matrices here are small and many: threads of the linear algebra cost more than they give."""
    import os

    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def _run(arguments: Sequence[str], messages: Messages) -> int:
    """Parse and run one command line; the exit code that it asks for."""
    import os

    from click.exceptions import Exit

    from enginediag_cli.cli.main import enginediag

    if "_ENGINEDIAG_COMPLETE" in os.environ:
        enginediag.main(list(arguments), prog_name="enginediag")
    try:
        with enginediag.make_context("enginediag", list(arguments), obj=messages) as context:
            result = enginediag.invoke(context)
    except Exit as asked:
        return asked.exit_code
    return int(result) if isinstance(result, int) else ExitCode.DONE


def _report(error: BaseException, messages: Messages) -> int:
    """Say on stderr what went wrong and return the exit code."""
    import click

    if messages.debug and not isinstance(error, SystemExit):
        import traceback

        traceback.print_exception(error)
    if isinstance(error, (KeyboardInterrupt, click.Abort)):
        messages.error("interrupted")
        return ExitCode.INTERRUPTED
    if isinstance(error, BrokenPipeError):
        return ExitCode.BROKEN_PIPE
    if (stop := _stop_request(error)) is not None:
        return stop.code if isinstance(stop.code, int) else ExitCode.INTERNAL
    if isinstance(error, click.ClickException):
        from enginediag_cli.safe_text import visible

        output = io.StringIO()
        error.show(file=output)
        messages.record("error", error.format_message())
        with suppress(OSError):
            click.echo(visible(output.getvalue()), err=True, nl=False)
        return ExitCode.TROUBLE
    if isinstance(error, ConfigError):
        messages.problems(error)
        return error.exit_code
    if isinstance(error, EngineDiagError):
        messages.error(str(error))
        return error.exit_code
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        messages.error(f"{where}{error.strerror or error}")
        return ExitCode.TROUBLE
    messages.error(f"internal error: {type(error).__name__}: {error}", **_where_from(error, messages))
    if not messages.debug:
        messages.error("this is a fault of the program, not of your data; run with --debug for the traceback")
    return ExitCode.INTERNAL


def _stop_request(error: BaseException | None) -> SystemExit | None:
    """The request to stop that an error is or follows from: Python wraps one that comes while a class is made."""
    while error is not None and not isinstance(error, SystemExit):
        error = error.__cause__ or error.__context__
    return error


def _where_from(error: BaseException, messages: Messages) -> dict[str, str]:
    """The traceback, for the log: of a run that nobody watched it is all that there is to find a fault by."""
    if messages.log is None:
        return {}
    import traceback

    return {"traceback": "".join(traceback.format_exception(error))}


def _discard_unwritable_output() -> None:
    """Let Python's own flush at exit succeed: it would otherwise fail again and end with code 120."""
    from enginediag_cli.report.messages import silence

    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            silence(stream)
        except (AttributeError, ValueError):  # None or closed: nothing is left to flush
            continue


def _leave_no_half_written_file_when_terminated() -> None:
    """Turn SIGTERM, and SIGHUP unless `nohup` ignores it, into an exception, so that temporary files are removed on
    the way out."""
    import signal

    def stop(number: int, frame: object) -> None:
        raise SystemExit(128 + number)

    signal.signal(signal.SIGTERM, stop)
    hangup = getattr(signal, "SIGHUP", None)
    if hangup is not None and signal.getsignal(hangup) is signal.SIG_DFL:
        signal.signal(hangup, stop)


class _ClosedOutput(io.TextIOBase):
    """Standard output that the shell has closed (`>&-`): writing to it is an error."""

    def write(self, text: str) -> int:
        raise OSError(errno.EBADF, "standard output is closed")


def _open_closed_streams() -> None:
    """A closed standard stream leaves a number free that the next file would get, and with it what is meant for the
    stream; and Python puts None in its place."""
    import os

    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number: this one
    if sys.stdout is None:
        sys.stdout = _ClosedOutput()
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")


def _write_utf_8() -> None:
    """Files and pipes get UTF-8 whatever the locale; a terminal gets what it can show."""
    from enginediag_cli.safe_text import UNSPEAKABLE

    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            if stream.isatty():
                stream.reconfigure(errors="replace")
            else:
                stream.reconfigure(encoding="utf-8", errors=UNSPEAKABLE)


if __name__ == "__main__":
    sys.exit(main())
