"""The ground station's example, run in a shell that has nothing but PATH, on recordings of a small engine."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from healthy_files import make

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "configs" / "ground_station"

pytestmark = pytest.mark.skipif(shutil.which("flock") is None, reason="needs flock, of util-linux")


class Station:
    """A station in a folder, and the script in a bare environment."""

    def __init__(self, folder: Path):
        self.folder = folder / "station"
        made = make(folder, records=60).texts
        (self.folder / "engines").mkdir(parents=True)
        (self.folder / "incoming").mkdir()
        (self.folder / "engines" / "engine.yaml").write_text(made["engine.yaml"])
        (self.folder / "engines" / "ESN1.yaml").write_text(made["nominal.yaml"])
        shutil.copy(EXAMPLE / "enginediag.yaml", self.folder)
        self.recordings = {name: made[f"{name}.csv"] for name in ("flight", "faulty")}
        self.bin = folder / "bin"
        self.bin.mkdir()
        program = f'#!/bin/sh\nPYTHONPATH={ROOT} exec {sys.executable} -m enginediag_cli "$@"\n'
        self.program("enginediag", program)
        self.mail = folder / "mail.txt"
        self.hook = self.program("alarm", f'#!/bin/sh\n{{ echo "to: $1"; cat; }} >>{self.mail}\n')

    def program(self, name: str, text: str) -> Path:
        path = self.bin / name
        path.write_text(text)
        path.chmod(0o755)
        return path

    def arrives(self, name: str, text: str) -> None:
        """A recording that was complete an hour ago."""
        path = self.folder / "incoming" / name
        path.write_text(text)
        os.utime(path, (time.time() - 3600,) * 2)

    def nightly(self, *environment: str) -> subprocess.CompletedProcess[str]:
        path = f"PATH={self.bin}:/usr/bin:/bin"
        command = ["env", "-i", path, f"STATION={self.folder}", *environment, str(EXAMPLE / "nightly.sh")]
        return subprocess.run(command, capture_output=True, text=True, timeout=120, cwd="/", stdin=subprocess.DEVNULL)

    def log(self) -> list[dict]:
        return [json.loads(line) for line in (self.folder / "runs.jsonl").read_text().splitlines()]

    def ends(self) -> list[tuple[str, int]]:
        return [(line["command"], line["exit_code"]) for line in self.log() if line.get("event") == "end"]

    def names(self, folder: str) -> list[str]:
        return sorted(os.listdir(self.folder / folder))


@pytest.fixture
def station(tmp_path) -> Station:
    return Station(tmp_path)


def test_a_night_judges_what_arrived_alarms_once_and_the_next_one_has_nothing_to_do(station):
    station.arrives("ESN1_0001.csv", station.recordings["flight"])
    station.arrives("ESN1_0002.csv", station.recordings["faulty"])
    (station.folder / "incoming" / "ESN1_0003.csv").write_text("flight,mach\n1,")  # is arriving
    first = station.nightly(f"ALARM={station.hook}")
    assert (first.returncode, first.stdout, first.stderr) == (1, "", "")
    assert station.names("results") == ["ESN1_0001.detect.csv", "ESN1_0002.detect.csv", "ESN1_0002.isolate.csv"]
    mail = station.mail.read_text()
    assert mail.startswith("to: ESN1_0002: a change was found\n")
    assert "compressor isentropic efficiency fell by" in mail
    ends = [("check", 0), ("detect", 0), ("detect", 1), ("isolate", 0)]
    assert station.ends() == ends
    assert [len(line["outputs"]) for line in station.log() if line.get("event") == "end"] == [0, 1, 1, 1]
    found = next(line for line in station.log() if line.get("verdict") == "fault")
    assert found["file"] == "incoming/ESN1_0002.csv"
    head = (station.folder / "results" / "ESN1_0001.detect.csv").read_text()
    assert "# schema: enginediag/detect/" in head
    assert "# option false-alarm: 0.001 (enginediag.yaml)" in head
    second = station.nightly(f"ALARM={station.hook}")
    assert (second.returncode, second.stdout, second.stderr) == (0, "", "")
    assert station.mail.read_text() == mail
    assert station.ends() == [*ends, ("check", 0)]
    assert station.names("work") == []


def test_a_recording_that_cannot_be_judged_is_put_aside_and_one_whose_engine_is_not_known_waits(station):
    station.arrives("ESN1_0001.csv", "flight,altitude_m\n1,high\n")
    station.arrives("ESN2_0001.csv", station.recordings["flight"])
    told = station.nightly(f"ALARM={station.hook}")
    assert (told.returncode, told.stderr) == (2, "")
    assert (station.names("rejected"), station.names("results")) == (["ESN1_0001.csv"], [])
    mail = station.mail.read_text()
    assert "to: ESN1_0001: is no recording that can be judged: put into rejected/" in mail
    assert "to: ESN2_0001: no nominal engine that can be used: engines/ESN2.yaml" in mail
    assert station.names("incoming") == ["ESN2_0001.csv"]


def test_an_alarm_that_could_not_be_told_is_told_by_the_next_run_and_without_a_hook_it_is_printed(station):
    station.arrives("ESN1_0002.csv", station.recordings["faulty"])
    failing = station.program("failing", "#!/bin/sh\nexit 1\n")
    told = station.nightly(f"ALARM={failing}")
    assert told.returncode == 2
    assert "is kept for the next run" in told.stderr
    assert station.names("alarms") == ["ESN1_0002.unsent"]
    told = station.nightly()
    assert told.returncode == 0
    assert told.stdout.startswith("ESN1_0002: a change was found\n")
    assert station.names("alarms") == ["ESN1_0002.sent"]


def test_options_that_are_wrong_stop_the_night_and_no_recording_suffers(station):
    station.arrives("ESN1_0001.csv", station.recordings["flight"])
    with open(station.folder / "enginediag.yaml", "a") as stream:
        stream.write("detct: {window: 60}\n")
    told = station.nightly()
    assert told.returncode == 2
    assert "unknown key 'detct' (did you mean 'detect'?)" in told.stderr
    assert station.names("incoming") == ["ESN1_0001.csv"]


def test_a_run_beside_another_ends_with_75_and_one_that_is_killed_has_judged_nothing(station):
    station.arrives("ESN1_0002.csv", station.recordings["faulty"])
    lock = station.folder / "nightly.lock"
    with subprocess.Popen(["flock", "--no-fork", str(lock), "sleep", "60"]) as other:
        until = time.monotonic() + 10
        while not lock.exists() and time.monotonic() < until:
            time.sleep(0.02)
        time.sleep(0.1)
        told = station.nightly()
        other.kill()
    assert told.returncode == 75
    assert "another run is at work" in told.stderr
    station.program("enginediag", '#!/bin/sh\nif [ "$1" = detect ]; then kill -9 $$; fi\n')
    ended = station.nightly()
    assert ended.returncode == 2 and "ESN1_0002: detect ended with 137" in ended.stdout
    assert station.names("results") == []


def test_whatever_one_recording_ends_with_the_others_are_judged(station):
    program = station.bin / "enginediag"
    real = program.rename(station.bin / "real")
    station.program("enginediag", f'#!/bin/sh\ncase "$*" in detect*0001*) exit 70;; esac\nexec {real} "$@"\n')
    station.arrives("ESN1_0001.csv", station.recordings["flight"])
    station.arrives("ESN1_0003.csv", station.recordings["flight"])
    ended = station.nightly(f"ALARM={station.hook}")
    assert ended.returncode == 2
    assert station.names("results") == ["ESN1_0003.detect.csv"]
    assert "to: ESN1_0001: detect ended with 70, and is tried again in the next run" in station.mail.read_text()
    assert station.names("incoming") == ["ESN1_0001.csv", "ESN1_0003.csv"]


def test_the_script_is_clean_and_the_units_name_it(tmp_path):
    script = EXAMPLE / "nightly.sh"
    assert os.access(script, os.X_OK)
    assert subprocess.run(["bash", "-n", str(script)]).returncode == 0
    places = {re.search(r"/\S+/nightly\.sh", (EXAMPLE / name).read_text())[0] for name in UNITS[:2]}
    assert places == {"/opt/enginediag/share/enginediag/configs/ground_station/nightly.sh"}
    fields = (EXAMPLE / "crontab").read_text().splitlines()[-1].split()
    assert len(fields) == 6 and all(re.fullmatch(r"\*|\d+", field) for field in fields[:5])


UNITS = ("enginediag-nightly.service", "crontab", "enginediag-nightly.timer")


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
def test_systemd_takes_the_service_and_its_timer(tmp_path):
    program = tmp_path / "nightly.sh"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    for name in (UNITS[0], UNITS[2]):
        text = (EXAMPLE / name).read_text()
        (tmp_path / name).write_text(re.sub(r"(?m)^ExecStart=.*", f"ExecStart={program}", text))
    files = [str(tmp_path / name) for name in (UNITS[0], UNITS[2])]
    done = subprocess.run(["systemd-analyze", "verify", "--man=no", *files], capture_output=True, text=True)
    told = [line for line in done.stderr.splitlines() if "enginediag" in line]
    assert (done.returncode, told) == (0, [])
    done = subprocess.run(["systemd-analyze", "calendar", "*-*-* 03:17"], capture_output=True, text=True)
    assert done.returncode == 0
