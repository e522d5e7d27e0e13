"""`check`: every problem of every file, one line for each good one."""

from __future__ import annotations

import pytest

FAULTS = """\
kind: faults
description: fouling
faults:
  - name: fouling
    changes: {hpc.efficiency: -0.02, hpc.flow_capacity: -4e-2}
"""
FLIGHT = "# made by hand\ntime_s,T3_K,note\n0,700,start\n1,,\n2,701.5,\n"


@pytest.fixture
def files(tmp_path):
    def write(**texts: str) -> list[str]:
        paths = [tmp_path / name.replace("__", ".") for name in texts]
        for path, text in zip(paths, texts.values(), strict=True):
            path.write_text(text, encoding="utf-8")
        return [str(path) for path in paths]

    return write


def test_good_files_get_a_line_each_and_exit_0(run, files):
    faults, flight = files(faults__yaml=FAULTS, flight__csv=FLIGHT)
    ended = run("check", faults, flight)
    assert ended.exit_code == 0
    assert ended.stderr == ""
    assert ended.stdout.splitlines() == [
        f"{faults}: ok, a file of kind faults",
        f"{flight}: ok, 3 records, 2 columns of numbers, 1 of text",
        "  T3_K: 1 of 3 values masked (missing 1)",
    ]


def test_all_problems_of_all_files_are_said_with_their_lines_and_exit_2(run, files):
    broken = FAULTS.replace("changes", "chages").replace("description: fouling", "description: 3")
    paths = files(a__yaml=broken, b__yaml="kind: fault\n", c__csv=FLIGHT.replace("701.5", "7o1"), d__yaml=FAULTS)
    ended = run("check", *paths)
    assert ended.exit_code == 2
    assert ended.stdout == f"{paths[3]}: ok, a file of kind faults\n"
    assert ended.stderr.splitlines() == [
        f'{paths[0]}:2:14: error: description must be a text, not the number 3 (put it in quotes: "3")',
        "    2 | description: 3",
        "      |              ^",
        f"{paths[0]}:5:5: error: unknown key 'chages' in faults.fouling (did you mean 'changes'?)",
        "    5 |     chages: {hpc.efficiency: -0.02, hpc.flow_capacity: -4e-2}",
        "      |     ^~~~~~",
        f"{paths[1]}:1:7: error: unknown kind of file, the text 'fault' (did you mean 'faults'?)",
        "    1 | kind: fault",
        "      |       ^~~~~",
        f"error: {paths[2]}:5:T3_K: not a number: '7o1'",
    ]


def test_what_only_building_shows_is_said_too(run, files):
    [path] = files(empty__yaml="kind: faults\n")
    ended = run("check", path)
    assert ended.exit_code == 2
    assert f"{path}:1:1: error: the file describes no fault" in ended.stderr


def test_a_file_that_is_not_there_does_not_stop_the_others(run, files, tmp_path):
    [good] = files(good__yml=FAULTS)
    absent = tmp_path / "absent.yaml"
    ended = run("check", absent, tmp_path / "absent.csv", good)
    assert ended.exit_code == 2
    assert "ok, a file of kind faults" in ended.stdout
    assert f"{absent}: error: cannot read the file: no such file or directory" in ended.stderr
    assert "absent.csv" in ended.stderr


def test_a_dash_is_a_recording_on_standard_input(run):
    ended = run("check", "-", stdin=FLIGHT)
    assert ended.exit_code == 0
    assert ended.stdout.startswith("<stdin>: ok, 3 records")


def test_no_file_is_a_usage_error(run):
    assert run("check").exit_code == 2
