"""Nothing silent, nothing destroyed: what the program owes its users about files, one fact a test, by its commands.

Where each fact of that list stands that is not here:

- a sensor that is not recorded is no suspect, rows say how many were judged: residuals/test_window_commands.py
- a frozen recorder in detect, its copies included: residuals/test_window_commands.py, recordings/test_masking.py
- masks whatever the chunks, inputs that stand still: recordings/test_masking.py
- an output that is an input, by path, link or redirection; .parquet and .html: cli/test_output_files.py
- nan and infinity of any option; closed and full standard streams: cli/test_output_files.py
- a file without records in detect, isolate, trend, residual: residuals/test_window_commands.py
- edited numbers of a nominal, another engine's, another instance: identification/test_nominal_checks.py
- copies of flights within and between files: identification/test_repeats.py, recordings/test_masking.py
- statistics put together, given twice, edited, of another nominal: residuals/test_statistics_file.py
- files outside the folder, links, devices, pipes, sizes; fifty problems: config/test_reading.py
- control characters and formulas: cli/test_general.py, cli/test_terminal.py, test_safe_text.py
- killed workers: validation/test_parent.py; two loads: engine/test_loads.py; edges of a table: engine/test_table_map.py
- a switch that is neither on nor off, in the engine: engine/test_switch_columns.py
- damaged files by the thousand: mutations/
"""

from __future__ import annotations

import csv
import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
from healthy_files import make

ROOT = Path(__file__).parents[2]
N = 120


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A turbojet: engine.yaml, nominal.yaml, flight.csv, faulty.csv, flights.csv (three flights in one file)."""
    path = tmp_path_factory.mktemp("silent")
    make(path, records=N)
    return path


def table(name):
    """Header and rows of a file here."""
    with open(name, encoding="utf-8") as stream:
        rows = list(csv.reader(line for line in stream if not line.startswith("#")))
    return rows[0], rows[1:]


def write(name, header, rows):
    with open(name, "w", encoding="utf-8", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows([header, *rows])


def rows_of(ended):
    return list(csv.DictReader(line for line in io.StringIO(ended.stdout) if not line.startswith("#")))


COMMANDS = {
    "detect": ("detect", "-n", "nominal.yaml"),
    "detect --follow": ("detect", "-n", "nominal.yaml", "--follow", "--idle", "0"),
    "isolate": ("isolate", "-n", "nominal.yaml", "--nonlinear", "never"),
    "residual": ("residual", "-n", "nominal.yaml"),
    "residual records": ("residual", "-n", "nominal.yaml", "--what", "records"),
    "trend": ("trend", "-n", "nominal.yaml"),
    "identify": ("identify", "engine.yaml", "--no-cross-validation"),
    "locate": ("locate", "engine.yaml"),
    "explain": ("explain", "engine.yaml"),
    "refine": ("refine", "engine.yaml", "--holdout-last", "1", "-o", "refined.yaml"),
}
"""Every command that reads recordings for an engine, but check, whose report has tests of its own."""


# --- sensors --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", [*COMMANDS, "check"])
def test_a_misspelt_sensor_is_told_by_every_command_with_a_near_match(here, run, command):
    header, rows = table("flights.csv")
    write("miss.csv", ["T3_k" if c == "T3_K" else c for c in header], rows)
    ended = run(*COMMANDS.get(command, ("check", "-n", "nominal.yaml")), "miss.csv")
    assert ended.exit_code in (0, 3)
    said = [line for line in (ended.stdout + ended.stderr).splitlines() if "no column T3_K" in line]
    assert len(said) == 1 and "did you mean 'T3_k'?" in said[0]


@pytest.mark.parametrize("command", ["detect", "detect --follow", "isolate", "residual"])
def test_rows_say_how_many_sensors_were_judged(here, run, command):
    header, rows = table("flight.csv")
    write("miss.csv", ["T3_k" if c == "T3_K" else c for c in header], rows)
    found = rows_of(run(*COMMANDS[command], "miss.csv"))
    assert {(row["sensors"], row["sensors_of"]) for row in found} == {("4", "5")}


@pytest.mark.parametrize("command", ["detect", "detect --follow", "isolate"])
def test_one_sensor_alone_gives_no_verdict_and_no_alarm(here, run, command):
    header, rows = table("faulty.csv")
    lost = [k for k, c in enumerate(header) if c in ("N1_rpm", "P3_Pa", "T5_K", "P5_Pa")]
    kept = [k for k in range(len(header)) if k not in lost]
    write("one.csv", [header[k] for k in kept], [[row[k] for k in kept] for row in rows])
    ended = run(*COMMANDS[command], "one.csv", "--exit-code")
    assert ended.exit_code == 3 and "fault" not in {row.get("verdict") for row in rows_of(ended)}
    assert {row.get("alarm") for row in rows_of(ended)} <= {"false", "", None}


# --- recorders that stand still -------------------------------------------------------------------------------------


@pytest.mark.parametrize("clock", ["runs", "stands"])
@pytest.mark.parametrize("command", ["detect", "detect --follow", "isolate"])
def test_a_frozen_recorder_is_no_verdict_and_never_a_fault(here, run, command, clock):
    header, rows = table("faulty.csv")
    time = header.index("time_s")
    still = [list(rows[40]) for _ in range(60)]
    for k, row in enumerate(still):
        row[time] = str(10 * k) if clock == "runs" else row[time]
    write("frozen.csv", header, still)
    ended = run(*COMMANDS[command], "frozen.csv", "--exit-code")
    found = rows_of(ended)
    if clock == "stands" and command == "detect --follow":  # the first is followed before there is a copy of it
        assert sum(int(row["records"]) for row in found) == 1 and {row["alarm"] for row in found} == {"false"}
        assert "59 records that repeat an earlier one" in ended.stderr
        return
    assert ended.exit_code == 3, ended.stdout + ended.stderr
    assert {row.get("verdict", "no verdict") for row in found} <= {"no verdict"}
    assert {row.get("alarm") for row in found} <= {"false", "", None}
    assert "in which nothing moves" in ended.stderr


def test_a_recorder_that_freezes_on_the_way_raises_no_alarm_while_the_flight_is_followed(here, run):
    header, rows = table("flight.csv")
    time = header.index("time_s")
    for at in range(20, 80, 7):  # whatever the noise of the record that is repeated
        frozen = [list(row) for row in rows]
        for k in range(at, N):
            frozen[k] = [*rows[at][:time], rows[k][time], *rows[at][time + 1 :]]
        write("frozen.csv", header, frozen)
        ended = run(*COMMANDS["detect --follow"], "frozen.csv", "--exit-code")
        assert ended.exit_code == 0, at
        assert all(row["alarm"] == "false" for row in rows_of(ended))


def test_readings_without_noise_raise_no_alarm_and_are_no_verdict(here, run):
    conditions = ("--conditions", "flight.csv")
    assert run("simulate", "engine.yaml", *conditions, "--noise", "none", "-o", "smooth.csv").exit_code == 0
    for command in ("detect", "detect --follow"):
        ended = run(*COMMANDS[command], "smooth.csv", "--exit-code")
        assert ended.exit_code == 3 and "impossibly little" in ended.stdout, ended.stdout


# --- the same records, the same masks -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def long_flight(folder, tmp_path_factory):
    """4,000 records with T3 stuck for 30 of them, from record `at` on: a function of it."""
    header, rows = None, []
    with open(folder / "flight.csv", encoding="utf-8") as stream:
        header, *rows = csv.reader(line for line in stream if not line.startswith("#"))
    path = tmp_path_factory.mktemp("long")
    T3, time = header.index("T3_K"), header.index("time_s")

    def made(at):
        out = []
        for k in range(4000):
            row = list(rows[k % len(rows)])
            row[time] = str(k)
            row[T3] = repr(float(row[T3]) + 1e-4 * (k // len(rows)))
            out.append(row)
        for k in range(at, at + 30):
            out[k][T3] = out[at][T3]
        write(path / f"{at}.csv", header, out)
        return path / f"{at}.csv"

    return made


@pytest.mark.parametrize("at", [2984, 2884])
def test_masks_are_the_same_for_check_identify_and_detect_on_either_side_of_a_border(here, run, long_flight, at):
    file = long_flight(at)
    said = {}
    for name, words in (
        ("check", ("check", "-n", "nominal.yaml")),
        ("identify", (*COMMANDS["identify"], "--first", "60", "-o", "n.yaml")),
        ("detect", (*COMMANDS["detect"], "--linearise", "nominal")),
        ("explain", ("explain", "engine.yaml", "--first", "60")),
    ):
        ended = run(*words, file)
        lines = (ended.stdout + ended.stderr).splitlines()
        said[name] = [line.split("T3_K:")[1] for line in lines if "T3_K:" in line and "masked" in line]
    said = {name: lines for name, lines in said.items() if name != "explain" or lines}
    assert {tuple(lines) for lines in said.values()} == {(" 30 of 4000 readings masked (stuck 30)",)}, said


@pytest.mark.parametrize("command", ["detect", "identify", "explain", "check"])
def test_an_input_that_stands_still_is_an_input_and_never_stuck(here, run, command):
    header, rows = table("flight.csv")
    power = header.index("Wf_kg_s")
    for row in rows[30:90]:
        row[power] = rows[30][power]
    write("conditions.csv", header, rows)
    assert run("simulate", "engine.yaml", "--conditions", "conditions.csv", "-o", "held.csv").exit_code == 0
    ended = run(*COMMANDS.get(command, ("check", "-n", "nominal.yaml")), "held.csv")
    assert "Wf_kg_s" not in "".join(line for line in (ended.stdout + ended.stderr).splitlines() if "masked" in line)


# --- no record, another engine, changed files -----------------------------------------------------------------------


@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_without_records_is_no_verdict_in_every_command(here, run, command):
    header, _ = table("flights.csv")
    write("head.csv", header, [])
    words = COMMANDS[command]
    for more in ((), ("--exit-code",)):
        if more and words[0] in ("residual", "trend", "identify", "refine"):
            continue
        ended = run(*words, "head.csv", *more)
        assert ended.exit_code == 3, ended.stderr
        assert not rows_of(ended)


@pytest.mark.parametrize("command", ["detect", "isolate", "residual", "trend", "check", "detect --follow"])
@pytest.mark.parametrize("change", ["component renamed", "another engine", "design changed", "edited nominal"])
def test_what_does_not_fit_the_nominal_is_refused_with_its_place(here, run, command, change):
    engine = Path("engine.yaml")
    text = engine.read_text(encoding="utf-8")
    if change == "component renamed":
        engine.write_text(
            text.replace("name: turbine", "name: hpt").replace("turbine.", "hpt.").replace("turbine_", "hpt_"),
            encoding="utf-8",
        )
    elif change == "another engine":
        engine.write_bytes((ROOT / "configs" / "turbofan.yaml").read_bytes())
    elif change == "design changed":
        at = text.index("pressure_ratio: ") + len("pressure_ratio: ")
        engine.write_text(f"{text[:at]}1{text[at:]}", encoding="utf-8")
    else:
        nominal = Path("nominal.yaml").read_text(encoding="utf-8")
        Path("nominal.yaml").write_text(nominal.replace("rho1: 0.1", "rho1: -1", 1), encoding="utf-8")
    words = COMMANDS.get(command, ("check", "-n", "nominal.yaml"))
    ended = run(*words, "flight.csv")
    assert (ended.exit_code, ended.stdout) == (2, "")
    assert "nominal.yaml" in ended.stderr and "error" in ended.stderr
    if change in ("component renamed", "another engine"):
        ended = run(*words, "flight.csv", "--accept-changed-engine")
        assert ended.exit_code == 2 and "has no parameter" in ended.stderr


@pytest.mark.parametrize("command", ["detect", "isolate", "residual", "trend", "check", "detect --follow"])
def test_a_changed_engine_file_can_be_accepted_and_is_told(here, run, command):
    with open("engine.yaml", "a", encoding="utf-8") as stream:
        stream.write("# a remark\n")
    words = COMMANDS.get(command, ("check", "-n", "nominal.yaml"))
    assert run(*words, "flights.csv").exit_code == 2
    ended = run(*words, "flights.csv", "--accept-changed-engine")
    assert ended.exit_code == 0
    assert "has changed since its nominal state was identified" in ended.stderr


@pytest.mark.parametrize("command", ["detect", "isolate", "residual", "trend", "check"])
def test_a_nominal_of_the_left_engine_on_the_right_one_is_told(here, run, command):
    header, rows = table("flights.csv")
    write("both.csv", [*header, "engine"], [[*row, side] for side in ("left", "right") for row in rows])
    made = run(*COMMANDS["identify"], "both.csv", "--engine-instance", "left", "-o", "left.yaml")
    assert made.exit_code == 0, made.stderr
    words = [w if w != "nominal.yaml" else "left.yaml" for w in COMMANDS.get(command, ("check", "-n", "left.yaml"))]
    ended = run(*words, "both.csv", "--engine-instance", "right")
    assert "was identified on engine 'left', and these are recordings of 'right'" in ended.stderr
    ended = run(*words, "both.csv", "--engine-instance", "left")
    assert "was identified on engine" not in ended.stderr


# --- the same thing twice -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", COMMANDS)
def test_the_same_file_or_a_copy_of_it_given_twice_is_refused(here, run, command):
    Path("copy.csv").write_bytes(Path("flights.csv").read_bytes())
    os.symlink("flights.csv", "link.csv")
    for again in ("flights.csv", "./flights.csv", "link.csv", "copy.csv"):
        ended = run(*COMMANDS[command], "flights.csv", again)
        assert ended.exit_code == 2 and "would count twice" in ended.stderr, again


@pytest.mark.parametrize(
    "command", ["detect", "detect --follow", "isolate", "residual", "identify", "explain", "check"]
)
def test_repeated_rows_are_told_and_counted_once(here, run, command):
    header, rows = table("flight.csv")
    write("twice.csv", header, [*rows, *rows[20:60]])
    ended = run(*COMMANDS.get(command, ("check", "-n", "nominal.yaml")), "twice.csv")
    assert any("40 records that repeat an earlier one" in x for x in (ended.stdout + ended.stderr).splitlines())
    if command in ("detect", "residual"):
        assert [row["records"] for row in rows_of(ended)] == [str(N)]


# --- standard streams -----------------------------------------------------------------------------------------------


def test_identify_writes_its_nominal_although_nobody_reads_what_it_says(here):
    line = (
        f"{sys.executable} -m enginediag_cli identify engine.yaml flights.csv --no-cross-validation -o new.yaml 2>&1"
        " | head -1"
    )
    done = subprocess.run(
        ["bash", "-c", line], capture_output=True, text=True, timeout=60, env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    assert done.returncode == 0
    assert Path("new.yaml").read_text(encoding="utf-8").count("\n") > 20


# --- what an engine file may say ------------------------------------------------------------------------------------


def test_a_switch_column_that_holds_a_half_is_told_and_its_records_are_not_computed(here, run):
    text = Path("engine.yaml").read_text(encoding="utf-8")
    block = "physics:\n  - {term: anti_ice_bleed, at: compressor, switch: anti_ice, coefficients: {fraction: 0.01}}\n"
    Path("engine.yaml").write_text(text + block, encoding="utf-8")
    header, rows = table("flight.csv")
    held = [*["0"] * 60, *["0.5"] * 5, *["1"] * (N - 65)]
    write("switch.csv", [*header, "anti_ice"], [[*row, v] for row, v in zip(rows, held, strict=True)])
    ended = run("check", "--engine", "engine.yaml", "switch.csv")
    assert "anti_ice is a switch, 0 or 1, and holds something else in 5 records" in ended.stdout
    ended = run(*COMMANDS["detect"], "switch.csv", "--accept-changed-engine")
    assert [row["failed"] for row in rows_of(ended)] == ["5"] and "5 records not computed" in ended.stderr


def test_an_engine_outside_the_folder_of_its_nominal_is_no_door_to_other_files(here, run):
    secret = Path("secret.txt")
    secret.write_text("SECRET_TOKEN=hunter2\n", encoding="utf-8")
    text = Path("nominal.yaml").read_text(encoding="utf-8")
    for target in (str(secret), "/etc/hostname", "/dev/zero", "/proc/self/environ"):
        changed = text.replace("engine.yaml", target)
        unsealed = "".join(line for line in changed.splitlines(True) if not line.startswith("checksum"))
        Path("door.yaml").write_text(unsealed, encoding="utf-8")
        ended = run("detect", "-n", "door.yaml", "flight.csv")
        assert ended.exit_code == 2
        assert "hunter2" not in ended.stderr and Path("/etc/hostname").read_text().strip() not in ended.stderr
