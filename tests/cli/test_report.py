"""`report` straight from recordings says what detect, isolate and trend say of them; pictures of the four commands."""

from __future__ import annotations

from importlib.util import find_spec

import pytest


@pytest.mark.slow
def test_a_report_of_recordings_is_that_of_the_results_of_the_commands(run, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("simulate", "turbofan.yaml", "--flights", "3", "--seed", "1", "-q", "-o", "healthy.csv").exit_code == 0
    fouled = ("--fault", "faults/hpc_fouling.yaml", "--flights", "5", "--seed", "7", "-q", "-o", "fouled.csv")
    assert run("simulate", "turbofan.yaml", *fouled).exit_code == 0
    identify = ("--no-cross-validation", "-q", "--picture", "fit.svg", "-o", "nominal.yaml")
    assert run("identify", "turbofan.yaml", "healthy.csv", *identify).exit_code == 0
    asked = ("-n", "nominal.yaml", "fouled.csv", "-q")
    picture = "d.png" if find_spec("resvg_py") else "d.svg"  # PNG takes a package that is no part of the tests
    assert run("detect", *asked, "-o", "d.csv", "--picture", picture).exit_code == 0
    assert run("isolate", *asked, "-o", "i.json", "--picture", "i.svg").exit_code == 0
    assert run("trend", *asked, "-o", "t.csv", "--picture", "t.svg").exit_code == 0
    assert run("residual", "--sensors", *asked, "-o", "s.csv").exit_code == 0
    read = run("report", "d.csv", "i.json", "t.csv", "s.csv", "nominal.yaml", "-q", "--static", "-o", "read.html")
    made = run("report", *asked, "--static", "-o", "made.html")
    assert (read.exit_code, made.exit_code) == (0, 0), read.stderr + made.stderr
    verdicts = [_verdict((tmp_path / name).read_text()) for name in ("read.html", "made.html")]
    assert verdicts[0] == verdicts[1] and "HPC isentropic efficiency fell by" in verdicts[0]
    for name in ("fit.svg", "i.svg", "t.svg"):
        assert (tmp_path / name).read_text().startswith("<svg")
    assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG" if picture == "d.png" else b"<svg")
    for said in ("Residuals over time", "Snapshots: cruise", "Health of the instruments", "Fingerprint of flight 5"):
        assert said in (tmp_path / "made.html").read_text()


def _verdict(page: str) -> str:
    return page.split('class="verdict">')[1].split("</p>")[0]


def test_a_recording_without_a_nominal_is_refused_with_what_to_give(run, tmp_path) -> None:
    ended = run("report", "sample_data/one_flight.csv", "-o", tmp_path / "x.html")
    assert ended.exit_code == 2 and "give -n NOMINAL" in ended.stderr
    assert not (tmp_path / "x.html").exists()


def test_a_nominal_without_a_recording_is_refused(run, tmp_path) -> None:
    (tmp_path / "d.csv").write_text("verdict,statistic,threshold,p_value,alarm\nhealthy,1,2,0.5,false\n")
    (tmp_path / "n.yaml").write_text("kind: nominal\n")
    ended = run("report", "-n", tmp_path / "n.yaml", tmp_path / "d.csv", "-o", tmp_path / "x.html")
    assert ended.exit_code == 2 and "none of the files is a recording" in ended.stderr


def test_files_that_cannot_be_read_are_named_and_the_others_reported(run, tmp_path) -> None:
    nominal, page = tmp_path / "nominal.yaml", tmp_path / "page.html"
    run("simulate", "turbojet.yaml", "--records", "200", "--seed", "1", "-q", "-o", tmp_path / "healthy.csv")
    identify = ["identify", "turbojet.yaml", tmp_path / "healthy.csv", "--no-cross-validation", "-q", "-o", nominal]
    assert run(*identify).exit_code == 0
    run("detect", "-n", nominal, tmp_path / "healthy.csv", "-o", tmp_path / "detect.json")
    (tmp_path / "empty.json").touch()
    (tmp_path / "junk.csv").write_bytes(bytes(range(128, 256)))
    wrong = [tmp_path / "empty.json", tmp_path / "junk.csv"]
    found = run("report", *wrong, tmp_path / "detect.json", "--static", "-o", page)
    assert found.exit_code == 0
    for text in (found.stderr, page.read_text(encoding="utf-8")):
        assert all(path.name in text for path in wrong)
    assert run("report", *wrong, "--static", "-o", tmp_path / "none.html").exit_code == 2
    assert not (tmp_path / "none.html").exists()
