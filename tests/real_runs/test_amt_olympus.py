"""A small turbojet on a bench whose probe behind the combustor cannot be right."""

from __future__ import annotations

import pytest
from ground_recordings import CONFIGS, enginediag, public_data, table

from enginediag_cli.identification.nominal_file import read_nominal

ENGINE = CONFIGS / "amt_olympus.yaml"
RECORDER = CONFIGS / "recorders" / "amt_olympus.yaml"

pytestmark = pytest.mark.shared_data


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """(nominal file, what identify said, the recording)."""
    recording = public_data("amt_olympus") / "bench.csv"
    path = tmp_path_factory.mktemp("amt") / "amt.yaml"
    _, said = enginediag("identify", ENGINE, recording, "--recorder", RECORDER, "-o", path)
    return path, said, recording


def test_the_probe_behind_the_combustor_is_named_alone_and_left_out(identified):
    path, said, _ = identified
    told = [line for line in said.splitlines() if "heat balances contradict" in line]
    assert len(told) == 1 and "contradict T4_K by" in told[0] and "excluded from the fit" in told[0]
    nominal = read_nominal(path)
    assert "T4_K" not in nominal.sensors and {"T3_K", "T5_K", "T7_K"} <= set(nominal.sensors)
    assert "T4_K" in nominal.provenance.values()


def test_no_load_is_invented_for_the_shaft(identified):
    offtake = next(e for e in read_nominal(identified[0]).estimates if e.name == "spool.power_offtake_W")
    assert abs(offtake.value) < offtake.prior_sigma
    assert offtake.status != "at bound"


def test_the_recording_that_it_was_identified_on_is_called_healthy(identified):
    path, _, recording = identified
    out, _ = enginediag("detect", "-n", path, recording, "--recorder", RECORDER, "-q")
    assert {row["verdict"] for row in table(out)} == {"healthy"}
