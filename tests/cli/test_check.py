"""`check`: every problem of every file, one line for each good one; of recordings whether they can be judged."""

from __future__ import annotations

import csv
import json

import pytest
from healthy_files import make

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
        "  T3_K: 1 of 3 readings masked (missing 1)",
    ]


def test_of_a_file_that_is_too_long_the_first_records_are_looked_over_and_that_is_said(run, files, monkeypatch):
    monkeypatch.setattr("enginediag_cli.intake.acceptance.MOST_CHECKED", 2)
    [flight] = files(flight__csv=FLIGHT)
    ended = run("check", flight)
    assert ended.exit_code == 0
    assert "the first 2 records were checked; the file continues" in ended.stdout


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


# --- the acceptance report of a recording ---------------------------------------------------------------------------

SENSORS = ("N1_rpm", "T3_K", "P3_Pa", "T5_K", "P5_Pa")
"""Of the turbojet that ships with the program."""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A sound turbojet flight with its nominal state, and the way to spoil it."""
    return Bench(tmp_path_factory.mktemp("bench"))


class Bench:
    """`spoilt(name, how)` writes the sound table with `how(columns)` done to it: columns by name, lists of text."""

    def __init__(self, folder):
        self.folder = folder
        make(folder, records=240)
        with open(folder / "flight.csv", encoding="utf-8") as stream:
            rows = list(csv.reader(line for line in stream if not line.startswith("#")))
        self.columns = dict(zip(rows[0], map(list, zip(*rows[1:], strict=True)), strict=True))

    def spoilt(self, name, how):
        columns = {c: list(cells) for c, cells in self.columns.items()}
        columns = how(columns) or columns
        path = self.folder / name
        with open(path, "w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))
        return str(path)

    def check(self, run, file, *options):
        """Exit code and rows."""
        ended = run("check", "-n", self.folder / "nominal.yaml", file, *options, "--format", "json")
        return ended.exit_code, json.loads(ended.stdout)


def told(rows, about, level=None):
    return [
        (row["name"], row["problem"] or row["found"])
        for row in rows
        if row["about"] == about and level in (None, row["level"])
    ]


def test_a_sound_recording_is_fit_and_its_report_is_short(bench, run):
    ended = run("check", "-n", bench.folder / "nominal.yaml", bench.folder / "flight.csv")
    assert (ended.exit_code, ended.stderr) == (0, "")
    assert ended.stdout.splitlines() == [
        f"{bench.folder}/flight.csv: ok, 240 records, 10 columns of numbers",
        f"  sensors: 5 of 5: {', '.join(SENSORS)}",
        "  inside the operating points identified: 240 of 240 records (100 %)",
    ]


def test_a_misspelt_sensor_is_a_warning_and_a_misspelt_input_ends_with_2(bench, run):
    file = bench.spoilt("a.csv", lambda c: {{"T3_K": "T3_k"}.get(k, k): v for k, v in c.items()})
    code, rows = bench.check(run, file)
    assert code == 0 and told(rows, "sensors", "warning")[0][0] == "T3_K"
    assert [row["hint"] for row in rows if row["name"] == "T3_K"] == ["did you mean 'T3_k'?"]
    file = bench.spoilt("b.csv", lambda c: {{"mach": "Mach"}.get(k, k): v for k, v in c.items()})
    ended = run("check", "-n", bench.folder / "nominal.yaml", file)
    assert ended.exit_code == 2 and "not fit to be judged" in ended.stdout
    assert "no column mach, which turbojet needs (did you mean 'Mach'?)" in ended.stderr


def test_without_a_sensor_a_number_or_a_record_nothing_can_be_judged(bench, run):
    for name, how, what in (
        ("none.csv", lambda c: {k: v for k, v in c.items() if k not in SENSORS}, "none of the sensors N1_rpm"),
        ("text.csv", lambda c: {"a": ["x"] * 240, "b": ["y"] * 240}, "no column of numbers"),
        ("head.csv", lambda c: {k: [] for k in c}, "there is no record"),
    ):
        ended = run("check", "-n", bench.folder / "nominal.yaml", bench.spoilt(name, how))
        assert ended.exit_code == 2 and what in ended.stderr, name
    one = bench.spoilt("one.csv", lambda c: {k: v for k, v in c.items() if k not in SENSORS[1:]})
    code, rows = bench.check(run, one)
    assert code == 0 and "too few sensors for a verdict" in str(told(rows, "sensors", "warning"))


@pytest.mark.parametrize(
    ("column", "factor", "offset", "unit"),
    [
        ("T3_K", 1.0, -273.15, "degC"),
        ("T5_K", 1.0, -273.15, "degC"),
        ("T5_K", 1.8, 0.0, "degR"),
        ("P3_Pa", 1e-3, 0.0, "kPa"),
        ("P3_Pa", 1 / 6894.757, 0.0, "psi"),
        ("N1_rpm", 1 / 60, 0.0, "Hz"),
        ("altitude_m", 1 / 0.3048, 0.0, "ft"),
        ("Wf_kg_s", 3600.0, 0.0, "kg_h"),
    ],
)
def test_a_unit_that_cannot_be_is_named_with_the_one_that_can(bench, run, column, factor, offset, unit):
    def how(columns):
        columns[column] = [repr(float(x) * factor + offset) for x in columns[column]]

    code, rows = bench.check(run, bench.spoilt("unit.csv", how))
    (found,) = (row for row in rows if row["about"] == "units")
    assert code == 2 and found["name"] == column and unit in found["hint"] and found["level"] == "problem"


def test_a_worn_engine_is_not_taken_for_a_wrong_unit(bench, run):
    def how(columns):
        columns["T5_K"] = [repr(float(x) * 1.08) for x in columns["T5_K"]]
        columns["P3_Pa"] = [repr(float(x) * 0.9) for x in columns["P3_Pa"]]

    code, rows = bench.check(run, bench.spoilt("worn.csv", how))
    assert code == 0 and not told(rows, "units")


def test_frozen_stretches_gaps_steps_back_and_copies_have_their_lines(bench, run):
    def how(columns):
        time = [float(t) for t in columns["time_s"]]
        for name in columns:
            columns[name][100:130] = [columns[name][100]] * 30
        columns["time_s"] = [repr(t + 600.0 * (k >= 180)) for k, t in enumerate(time)]
        columns["time_s"][220] = "5"
        for name in columns:
            columns[name] += columns[name][10:20]

    code, rows = bench.check(run, bench.spoilt("time.csv", how))
    assert code == 0
    frozen = [(row["line"], row["last_line"], row["count"]) for row in rows if row["about"] == "frozen"]
    assert frozen == [(102, 131, 30)]
    steps = [(row["line"], row["problem"]) for row in rows if row["about"] == "time"]
    assert any(line == 181 and "a gap of 610 s, where the usual step is 10 s" in text for line, text in steps)
    assert any(line == 221 and "time goes back" in text for line, text in steps)
    assert [row["count"] for row in rows if row["about"] == "repeated"] == [10]


def test_the_input_that_is_outside_is_named_with_how_many_records(bench, run):
    def how(columns):
        columns["altitude_m"][20:50] = ["15000"] * 30

    code, rows = bench.check(run, bench.spoilt("far.csv", how))
    (row,) = (row for row in rows if row["about"] == "envelope" and row["level"] == "warning")
    assert (code, row["name"], row["count"], row["line"]) == (0, "altitude_m", 30, 22)
    assert "altitude_m above 6000" in row["problem"]
    assert told(rows, "envelope", "note")[0][1].endswith("210 of 240 records (87.5 %)")

    def all_of_it(columns):
        columns["altitude_m"] = ["15000"] * 240

    assert bench.check(run, bench.spoilt("far.csv", all_of_it))[0] == 2


def test_the_counts_of_what_is_masked_are_those_of_detect(bench, run):
    def how(columns):
        columns["T3_K"][50:53] = [""] * 3
        columns["T5_K"][70] = "9000"
        columns["P3_Pa"][120:160] = [columns["P3_Pa"][120]] * 40

    file = bench.spoilt("masked.csv", how)
    code, rows = bench.check(run, file)
    ended = run("detect", "-n", bench.folder / "nominal.yaml", file)
    masked = [text for _, text in told(rows, "masked")]
    assert code == 0 and len(masked) == 3
    assert [line.removeprefix("masked.csv: ") for line in ended.stderr.splitlines() if "masked (" in line] == masked


def test_a_switch_that_is_neither_on_nor_off_is_named(bench, run, tmp_path):
    engine = (bench.folder / "engine.yaml").read_text(encoding="utf-8")
    block = "physics:\n  - {term: anti_ice_bleed, at: compressor, switch: anti_ice, coefficients: {fraction: 0.01}}\n"
    path = tmp_path / "engine.yaml"
    path.write_text(engine + block, encoding="utf-8")
    file = bench.spoilt("switch.csv", lambda c: {**c, "anti_ice": ["0"] * 100 + ["0.5"] * 3 + ["1"] * 137})
    ended = run("check", "--engine", path, file)
    assert ended.exit_code == 0, ended.stderr
    assert "anti_ice is a switch, 0 or 1, and holds something else in 3 records: '0.5' in line 102" in ended.stdout


def test_an_engine_without_a_nominal_says_what_it_can_and_a_recorder_maps(bench, run):
    folder = bench.folder
    ended = run("check", "--engine", folder / "engine.yaml", folder / "flight.csv")
    assert ended.exit_code == 0 and "sensors: 5 of 5" in ended.stdout and "identified" not in ended.stdout
    ended = run("check", "-n", folder / "nominal.yaml", "--recorder", folder / "recorder.yaml", folder / "foreign.csv")
    assert ended.exit_code == 0, ended.stderr
    assert (
        "sensors: 4 of 5" in ended.stdout
        and "no column P5_Pa" in ended.stdout
        and "240 of 240 records (100 %)" in ended.stdout
    )


def test_files_that_are_the_same_are_told_and_packed_ones_are_read(bench, run):
    import gzip

    sound = (bench.folder / "flight.csv").read_bytes()
    copy, packed = bench.folder / "copy.csv", bench.folder / "flight.csv.gz"
    copy.write_bytes(sound)
    packed.write_bytes(gzip.compress(sound))
    ended = run("check", "-n", bench.folder / "nominal.yaml", bench.folder / "flight.csv", copy, packed)
    assert ended.exit_code == 0 and ended.stdout.count(": ok, 240 records") == 3
    assert "hold the same bytes" in ended.stderr


def test_options_of_recordings_without_a_recording_are_a_usage_error(bench, run):
    ended = run("check", "-n", bench.folder / "nominal.yaml", bench.folder / "engine.yaml")
    assert ended.exit_code == 2 and "are for recordings" in ended.stderr
    ended = run("check", "-n", bench.folder / "nominal.yaml", "--engine", "turbojet.yaml", bench.folder / "flight.csv")
    assert ended.exit_code == 2 and "either" in ended.stderr
