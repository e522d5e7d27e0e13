"""Every way a run can end, as a shell sees it. 1 is kept for findings: nothing else may end with it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

ENVIRONMENT = {
    **{key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "FORCE_COLOR")},
    "PYTHONPATH": str(Path(__file__).parents[2]),
}

PROBE = '''
import time
import click
from enginediag_cli.cli.config import command
from enginediag_cli.cli.options import output_options, recordings_argument
from enginediag_cli.errors import ConfigError, DataError, ExitCode, Mark, NoVerdictError, Problem

ENDINGS = {
    "config": lambda: ConfigError([
        Problem(Mark("a.yaml", 3, 7), "unknown key 'spol'", "did you mean 'spool'?"),
        Problem(Mark("a.yaml", 9, 1), "missing key 'name'"),
    ]),
    "data": lambda: DataError("flight.csv:12:T3_K: 'abc' is not a number"),
    "no-verdict": lambda: NoVerdictError("only 3 records in the envelope"),
    "internal": lambda: KeyError("stray"),
    "permission": lambda: PermissionError(13, "Permission denied", "protected/nominal.yaml"),
    "click": lambda: click.ClickException("clicked"),
    "abort": lambda: click.Abort(),
    "recursion": lambda: RecursionError("too deep"),
}

@command()
@click.argument("ending")
@click.option("--rows", type=int, default=1)
@output_options
def probe(messages, ending, rows, output):
    """End in a chosen way."""
    if ending in ENDINGS:
        raise ENDINGS[ending]()
    if ending == "finding":
        return ExitCode.FINDING
    if ending == "exit":
        click.get_current_context().exit(ExitCode.FINDING)
    if ending == "slow":
        with output.open() as stream:
            stream.write("half")
            messages.note("started")
            time.sleep(60)
    if ending == "noted":
        messages.note("noted")
        return None
    if ending == "greek":
        return output.write_text("Δθ ± 1\\n")
    output.write_rows({"row": k, "text": "x" * 50} for k in range(rows))

@command()
@recordings_argument
def files(messages, recordings):
    """Say which files would be read."""
    click.echo(" ".join(recordings))
'''

START = """
import sys
import probe_commands
from enginediag_cli.cli import main
sys.modules["enginediag_cli.cli.probe_commands"] = probe_commands
main.COMMANDS["probe"] = main.CommandEntry("probe_commands", "")
main.COMMANDS["files"] = main.CommandEntry("probe_commands", "")
from enginediag_cli.__main__ import main as entry
sys.exit(entry())
"""


@pytest.fixture(scope="module")
def probe_folder(tmp_path_factory):
    """A folder with a command that ends in any way it is told to, and a script that starts it."""
    folder = tmp_path_factory.mktemp("probe")
    (folder / "probe_commands.py").write_text(textwrap.dedent(PROBE), encoding="utf-8")
    (folder / "start.py").write_text(START)
    return folder


@pytest.fixture
def start(probe_folder):
    """`start(*arguments, **popen_options)`: the program with the probe command, as a child process."""

    def run(*arguments: str, **options) -> subprocess.Popen:
        pipe = subprocess.PIPE
        options = {"stdin": subprocess.DEVNULL, "stdout": pipe, "stderr": pipe, "env": ENVIRONMENT, **options}
        command = [sys.executable, str(probe_folder / "start.py"), *arguments]
        return subprocess.Popen(command, text=True, **options)

    return run


@pytest.mark.parametrize(
    ("ending", "code", "message"),
    [
        ("done", 0, ""),
        ("finding", 1, ""),
        ("exit", 1, ""),
        ("data", 2, "error: flight.csv:12:T3_K: 'abc' is not a number\n"),
        ("permission", 2, "error: protected/nominal.yaml: Permission denied\n"),
        ("click", 2, "Error: clicked\n"),
        ("no-verdict", 3, "error: only 3 records in the envelope\n"),
        ("abort", 130, "error: interrupted\n"),
    ],
)
def test_each_ending_has_its_exit_code_and_one_line(start, ending, code, message):
    process = start("probe", ending)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (code, message)


def test_all_problems_of_a_configuration_are_shown_at_once(start):
    process = start("probe", "config")
    _, said = process.communicate(timeout=60)
    assert process.returncode == 2
    assert said.splitlines() == [
        "a.yaml:3:7: error: unknown key 'spol' (did you mean 'spool'?)",
        "a.yaml:9:1: error: missing key 'name'",
    ]


@pytest.mark.parametrize("ending", ["internal", "recursion"])
def test_an_internal_error_is_70_and_shows_its_traceback_only_with_debug(start, ending):
    process = start("probe", ending)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 70
    assert said.startswith("error: internal error: ")
    assert "--debug" in said
    assert "Traceback" not in said
    process = start("probe", ending, "--debug")
    _, said = process.communicate(timeout=60)
    assert process.returncode == 70
    assert "Traceback" in said


@pytest.mark.parametrize("rows", ["1", "100000"])
def test_a_broken_pipe_is_quiet_and_no_finding(start, rows):
    reading, writing = os.pipe()
    os.close(reading)
    process = start("probe", "done", "--rows", rows, stdout=writing)
    os.close(writing)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (141, "")


def test_head_takes_its_line_and_the_writer_leaves_quietly(start):
    process = start("probe", "done", "--rows", "100000")
    head = subprocess.run(["head", "-1"], stdin=process.stdout, capture_output=True, text=True, timeout=60)
    process.stdout.close()
    process.wait(timeout=60)
    assert head.stdout == "row,text\n"
    assert process.returncode == 141
    assert process.stderr.read() == ""
    process.stderr.close()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize("rows", ["1", "100000"])
def test_a_full_disk_is_trouble(start, rows):
    with open("/dev/full", "w") as full:
        process = start("probe", "done", "--rows", rows, stdout=full)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (2, "error: No space left on device\n")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_stopped_run_leaves_no_file(start, tmp_path, number, code):
    # a background job of a shell without job control inherits SIGINT ignored
    listen = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}
    process = start("probe", "slow", "-o", str(tmp_path / "out.csv"), **listen)
    assert process.stderr.readline() == "started\n"
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    assert process.returncode == code
    assert "Traceback" not in said
    assert os.listdir(tmp_path) == []


def test_an_output_in_a_missing_folder_is_refused_before_the_work(start, tmp_path):
    process = start("probe", "internal", "-o", str(tmp_path / "no" / "out.csv"))
    _, said = process.communicate(timeout=60)
    assert process.returncode == 2
    assert "there is no folder" in said


@pytest.mark.parametrize(("closed", "code"), [("<&- 2>&-", 3), ("<&- >&- 2>&-", 2)])
def test_closed_standard_streams_do_not_crash(probe_folder, closed, code):
    """Without standard output there is nowhere to write to, which is said before the work."""
    command = f'exec "{sys.executable}" "{probe_folder}/start.py" probe no-verdict {closed}'
    done = subprocess.run(["bash", "-c", command], env=ENVIRONMENT, timeout=60)
    assert done.returncode == code


def test_no_input_on_a_terminal_is_a_usage_error_and_does_not_hang(start):
    pty = pytest.importorskip("pty")
    leader, terminal = pty.openpty()
    process = start("files", stdin=terminal)
    _, said = process.communicate(timeout=60)
    os.close(leader)
    os.close(terminal)
    assert process.returncode == 2
    assert "no input: name a FILE, or pipe data in" in said


@pytest.mark.parametrize(
    ("options", "environment", "coloured"),
    [
        ((), {}, False),
        ((), {"FORCE_COLOR": "1"}, True),
        ((), {"FORCE_COLOR": "1", "NO_COLOR": "1"}, False),
        (("--color", "always"), {"NO_COLOR": "1"}, True),
        (("--color", "never"), {"FORCE_COLOR": "1"}, False),
    ],
)
def test_errors_are_coloured_as_the_option_and_no_color_say(start, options, environment, coloured):
    process = start(*options, "probe", "data", env={**ENVIRONMENT, **environment})
    _, said = process.communicate(timeout=60)
    assert ("\x1b[" in said) is coloured


def test_an_option_before_and_after_the_command_means_the_same(start):
    for arguments in [("-q", "probe", "noted"), ("probe", "noted", "-q")]:
        process = start(*arguments)
        assert process.communicate(timeout=60)[1] == ""


def test_data_in_a_pipe_are_utf_8_whatever_the_locale(start):
    process = start("probe", "greek", env={**ENVIRONMENT, "PYTHONIOENCODING": "ascii"}, encoding="utf-8")
    out, _ = process.communicate(timeout=60)
    assert (process.returncode, out) == (0, "Δθ ± 1\n")


def test_on_a_terminal_rows_are_a_table_and_in_a_pipe_csv(start):
    pty = pytest.importorskip("pty")
    leader, terminal = pty.openpty()
    process = start("probe", "done", stdout=terminal)
    assert process.wait(timeout=60) == 0
    os.close(terminal)
    shown = os.read(leader, 10_000).decode()
    os.close(leader)
    assert "row" in shown and "," not in shown
    assert start("probe", "done").communicate(timeout=60)[0].startswith("row,text\n0,x")


def test_piped_input_is_read_where_no_file_is_named(start):
    for arguments in [("files",), ("files", "-")]:
        process = start(*arguments, stdin=subprocess.PIPE)
        assert process.communicate("", timeout=60)[0] == "-\n"
        assert process.returncode == 0


def test_standard_input_is_read_only_once(start):
    process = start("files", "-", "-")
    _, said = process.communicate(timeout=60)
    assert process.returncode == 2
    assert "only once" in said


def test_a_slow_reader_sees_each_row_of_a_live_run_at_once(probe_folder):
    script = (
        "import sys\nfrom enginediag_cli.report.output import Output\n"
        "Output().write_rows(({'k': int(line)} for line in sys.stdin), live=True)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    )
    for k in range(3):
        process.stdin.write(f"{k}\n")
        process.stdin.flush()
        if k == 0:
            assert process.stdout.readline() == "k\n"
        assert process.stdout.readline() == f"{k}\n"
    process.stdin.close()
    process.stdout.close()
    assert process.wait(timeout=60) == 0
