from __future__ import annotations

import sysconfig
from pathlib import Path

import pytest

from enginediag_cli import shipped as module
from enginediag_cli.cli.options import ConfigFile
from enginediag_cli.errors import DataError
from enginediag_cli.shipped import INSTALLED, shipped, shipped_folder

CONFIGS = Path(__file__).parents[1] / "configs"


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A package without a checkout around it, with its configs in the data folder of the installation."""
    monkeypatch.setattr(module, "__file__", str(tmp_path / "site-packages" / "enginediag_cli" / "shipped.py"))
    monkeypatch.setattr(sysconfig, "get_path", lambda name, scheme: str(tmp_path / "prefix"))
    return tmp_path


def test_a_checkouts_own_configs_come_first():
    assert shipped("turbofan.yaml") == CONFIGS / "turbofan.yaml"
    assert shipped("faults/hpc_fouling.yaml") == CONFIGS / "faults" / "hpc_fouling.yaml"


def test_the_folders_name_may_be_part_of_the_name():
    assert shipped("configs/turbofan.yaml") == CONFIGS / "turbofan.yaml"


def test_without_a_checkout_the_data_folder_of_the_installation_is_used(installed):
    folder = installed / "prefix" / INSTALLED
    folder.mkdir(parents=True)
    (folder / "turbofan.yaml").touch()
    assert shipped("turbofan.yaml") == folder / "turbofan.yaml"


def test_a_configs_folder_of_somebody_else_beside_the_package_is_not_taken(installed):
    (installed / "site-packages" / "configs").mkdir(parents=True)
    with pytest.raises(DataError, match=r"not installed; looked in .*prefix"):
        shipped_folder()


@pytest.mark.parametrize(
    ("name", "hint"), [("turbofn.yaml", "turbofan.yaml"), ("hpc_fouling.yaml", "faults/hpc_fouling.yaml")]
)
def test_an_unknown_name_is_met_with_the_nearest_one(name, hint):
    with pytest.raises(DataError, match=f"did you mean .*{hint}"):
        shipped(name)


@pytest.mark.parametrize("name", ["", ".", "../pyproject.toml", "/etc/hostname"])
def test_only_files_below_the_folder_are_shipped(name):
    with pytest.raises(DataError):
        shipped(name)


def test_a_file_in_the_working_folder_goes_before_a_shipped_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert ConfigFile().convert("turbofan.yaml", None, None) == str(CONFIGS / "turbofan.yaml")
    Path("turbofan.yaml").touch()
    assert ConfigFile().convert("turbofan.yaml", None, None) == "turbofan.yaml"
