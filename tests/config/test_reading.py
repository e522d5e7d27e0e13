"""What may be read: regular files of a sane size, and inside a YAML file those of its own folder."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from enginediag_cli.config import files as reading
from enginediag_cli.config.document import load_document
from enginediag_cli.config.files import READING, file_inside, render_all
from enginediag_cli.config.validate import check_file
from enginediag_cli.errors import MOST_PROBLEMS, ConfigError
from enginediag_cli.identification.nominal_file import engine_file
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.shipped import shipped

SECRET = "SECRET_TOKEN=hunter2"


def engine_with_map(folder: Path, file: str) -> Path:
    text = shipped("turbojet.yaml").read_text(encoding="utf-8")
    table = f"  - type: compressor\n    table: {{file: {file}, interpolation: linear}}\n"
    path = folder / "engine.yaml"
    path.write_text(text.replace("  - type: compressor\n", table, 1), encoding="utf-8")
    return path


@pytest.fixture
def secret(tmp_path) -> Path:
    path = tmp_path / "secret"
    path.write_text(f"{SECRET}\n")
    return path


@pytest.fixture
def folder(tmp_path) -> Path:
    inside = tmp_path / "inside"
    inside.mkdir()
    return inside


def test_a_map_outside_the_folder_is_refused_at_its_place_and_not_quoted(folder, secret):
    for name in ("../secret", str(secret), "/proc/self/environ", "/etc/passwd"):
        path = engine_with_map(folder, name)
        with pytest.raises(ConfigError, match="outside the folder of this file") as refused:
            load_engine(path)
        assert "--allow-outside" in str(refused.value)
        assert refused.value.problems[0].mark.file == str(path)
        assert refused.value.problems[0].mark.line > 1
        assert SECRET not in str(refused.value)


def test_a_link_that_leads_outside_is_outside(folder, secret):
    os.symlink(secret, folder / "map.csv")
    with pytest.raises(ConfigError, match="outside the folder"):
        load_engine(engine_with_map(folder, "map.csv"))


def test_what_lies_in_the_folder_or_comes_with_the_program_is_allowed(folder):
    (folder / "maps").mkdir()
    (folder / "maps" / "a.csv").write_text("x\n")
    assert file_inside(folder / "engine.yaml", "maps/a.csv") == folder / "maps" / "a.csv"
    assert file_inside(folder / "study.yaml", str(shipped("turbofan.yaml"))) == shipped("turbofan.yaml")


def test_the_user_may_allow_files_outside(folder, secret, monkeypatch):
    monkeypatch.setattr(READING, "allow_outside", True)
    with pytest.raises(ConfigError, match="map columns missing") as refused:
        load_engine(engine_with_map(folder, "../secret"))
    assert SECRET not in str(refused.value)


@pytest.mark.parametrize("name", ["/dev/zero", "/dev/stdin"])
def test_a_device_is_not_read(folder, name, monkeypatch):
    with pytest.raises(ConfigError, match="a device or a pipe"):
        load_document(name)
    monkeypatch.setattr(READING, "allow_outside", True)
    with pytest.raises(ConfigError, match="a device or a pipe"):
        load_engine(engine_with_map(folder, name))


def test_a_pipe_is_not_waited_for(folder):
    os.mkfifo(folder / "pipe.yaml")
    with pytest.raises(ConfigError, match="a device or a pipe"):
        load_document(folder / "pipe.yaml")
    with pytest.raises(ConfigError, match="a device or a pipe"):
        load_engine(engine_with_map(folder, "pipe.yaml"))


def test_a_file_beyond_the_limit_is_not_read(folder, monkeypatch):
    big = folder / "big.yaml"
    with open(big, "wb") as stream:
        stream.truncate(reading.MOST_YAML_BYTES + 1)  # a hole: nothing is stored
    with pytest.raises(ConfigError, match="at most 20 MB are read"):
        load_document(big)
    with pytest.raises(ConfigError, match="at most 20 MB are read"):
        load_engine(engine_with_map(folder, "big.yaml"))


class Named:
    """As much of a nominal as says which engine it is of."""

    def __init__(self, engine_path: str):
        self.engine_path = engine_path


def test_the_engine_of_a_nominal_may_lie_anywhere_but_must_be_an_engine(folder, secret):
    engine = engine_file(Named(str(shipped("turbofan.yaml"))), folder / "nominal.yaml")  # type: ignore[arg-type]
    assert engine == shipped("turbofan.yaml")
    for name in ("../secret", "/etc/passwd", "/dev/zero", "absent.yaml"):
        with pytest.raises(ConfigError) as refused:
            engine_file(Named(name), folder / "nominal.yaml")  # type: ignore[arg-type]
        assert SECRET not in str(refused.value)
        assert "root:" not in str(refused.value)


def test_fifty_problems_are_told_and_the_rest_counted_in_little_time(folder):
    many = folder / "many.yaml"
    many.write_text("kind: engine\n" + "".join(f"unknown_key_{k}: {k}\n" for k in range(50_000)))
    begun = time.process_time()
    with pytest.raises(ConfigError) as refused:
        check_file(many)
    assert time.process_time() - begun < 5.0 * 3  # of a machine three times slower than the one it is meant for
    text = str(refused.value)
    assert text.count("error:") == MOST_PROBLEMS
    assert text.endswith(f"and {len(refused.value.problems) - MOST_PROBLEMS} more problems")


def test_a_huge_value_is_not_repeated_in_full(folder):
    path = folder / "one_line.yaml"
    path.write_text("kind: engine\nname: [" + "x" * 100_000 + "]\n" + "k" * 100_000 + ": 1\n")
    with pytest.raises(ConfigError) as refused:
        check_file(path)
    assert len(render_all(refused.value)) < 10_000
