"""Drafts of recorders: foreign files of different shapes, each drafted, accepted and read."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from shared_recordings import REPOSITORY, shared_data

from enginediag_cli.commands.main import enginediag
from enginediag_cli.errors import DataError
from enginediag_cli.recordings.draft import draft
from enginediag_cli.recordings.quantities import target_of
from enginediag_cli.recordings.recorder import load_recorder
from enginediag_cli.recordings.sniff import sniff

N = 60
K = np.arange(N)


def lines(rows) -> str:
    return "\n".join(rows) + "\n"


def german_bench() -> bytes:
    """Titles, semicolons, decimal commas, a unit row, a date and a time column, Western European text."""
    rows = ["Prüfstand 3", "Lauf 17;;;;;", "Datum;Uhrzeit;T3;P3;Kraftstoff;Prüfer", ";;°C;kPa;l/h;"]
    rows += [f"04.03.2024;10:00:{k:02d};{310 + 0.5 * k:.1f};{1200 + k}{',5'};{200 + k},25;Müller" for k in K]
    return lines([r.replace(".0;", ",0;").replace(".5;", ",5;") for r in rows]).encode("cp1252")


def two_engines() -> bytes:
    """Tabs, units in brackets, ISO stamps, engines 1 and 2 at the end of the names."""
    head = ["UTC", "Press Alt [ft]", "IAS [kts]", "OAT [degC]"]
    head += ["N1_1 [%]", "N1_2 [%]", "EGT_1 [degC]", "EGT_2 [degC]", "x"]
    cells = [(30000 + k, 250 + k, -44.5, 88 + k / 10, 87 + k / 10, 550 + k, 560 + k, k % 7) for k in K]
    rows = ["\t".join([f"2024-03-04T10:00:{k:02d}Z", *map(str, c)]) for k, c in zip(K, cells, strict=True)]
    return lines(["\t".join(head), *rows]).encode()


def no_units() -> bytes:
    """Commas, no unit anywhere: units follow from the values."""
    rows = [f"{k},{14.7 + k / 100},{59 + k / 50},{900 + k},{150 + k},{95 + k / 100},{500 + k},A7" for k in K]
    return lines(["time,P2,T2,T3,P3,NG,WF,flight", *rows]).encode()


def drafted(tmp_path, content: bytes, *options: str):
    file, yaml = tmp_path / "foreign.csv", tmp_path / "r.yaml"
    file.write_bytes(content)
    done = CliRunner().invoke(enginediag, ["recorder", str(file), "-o", str(yaml), *options])
    assert done.exit_code == 0, done.output
    assert CliRunner().invoke(enginediag, ["check", str(yaml)]).exit_code == 0
    recorder = load_recorder(yaml)
    return yaml.read_text(encoding="utf-8"), [m.recording for m in recorder.read(file)]


def test_a_bench_file_with_titles_unit_row_decimal_commas_and_date_and_time_is_drafted_and_read(tmp_path):
    text, (r,) = drafted(tmp_path, german_bench())
    assert "encoding: cp1252   # GUESSED" in text and "header_line: 3" in text and "unit_row: true" in text
    np.testing.assert_allclose(r["time_s"], K)
    np.testing.assert_allclose(r["T3_K"], 583.15 + 0.5 * K)
    np.testing.assert_allclose(r["P3_Pa"], 1e3 * (1200.5 + K))
    np.testing.assert_allclose(r["Wf_kg_s"], 800 * (200.25 + K) / 3.6e6)
    assert "density_kg_m3: 800}   # DECIDE: density of the fuel" in text and "#   Prüfer" in text


def test_two_engines_with_brackets_and_stamps_get_mach_from_airspeed_and_their_own_columns(tmp_path):
    text, (one, two) = drafted(tmp_path, two_engines())
    assert 'engine_1: {prefix: "1"}' in text and "rule: mach_from_cas" in text and "rule: isa_deviation" in text
    assert "full_scale: 10000}   # DECIDE" in text and "#   x" in text
    np.testing.assert_allclose(one["EGT_K"], 823.15 + K)
    np.testing.assert_allclose(two["EGT_K"], 833.15 + K)
    np.testing.assert_allclose(one["altitude_m"], 0.3048 * (30000 + K))
    assert 0.6 < one["mach"].min() < one["mach"].max() < 0.85 and one["time_s"][-1] == N - 1


def test_without_units_the_values_say_which_can_be_and_the_user_is_told(tmp_path):
    text, (r,) = drafted(tmp_path, no_units())
    assert 'P2_Pa: {from: "P2", unit: "psi"}   # DECIDE: unit guessed from the values' in text
    assert 'unit: "pct", full_scale: 10000}' in text and 'text: {flight: "flight"}' in text
    assert 'T3_K: {from: "T3", unit: "K"}   # DECIDE' in text  # 900 can be K or °F: the user decides
    np.testing.assert_allclose(r["P2_Pa"][0], 14.7 * 6894.757, rtol=1e-6)


def test_with_an_engine_its_columns_are_looked_for_and_those_missing_are_listed(tmp_path):
    engine = str(REPOSITORY / "configs" / "turbojet.yaml")
    text, _ = drafted(tmp_path, no_units(), "--engine", engine)
    assert "asks for these, and no column was taken for them:" in text and "#   T3_K" not in text
    assert "  P2_Pa:" not in text  # the turbojet has no such sensor


@pytest.mark.parametrize(
    ("content", "message"), [(b"\x00\x01", "binary data"), (b"one line\n", "no table"), (b"", "no table")]
)
def test_what_is_no_table_is_refused_in_words(tmp_path, content, message):
    file = tmp_path / "f.csv"
    file.write_bytes(content)
    with pytest.raises(DataError, match=message):
        sniff(str(file))


def test_the_recording_is_never_overwritten_by_its_draft(tmp_path):
    file = tmp_path / "f.csv"
    file.write_bytes(no_units())
    done = CliRunner().invoke(enginediag, ["recorder", str(file), "-o", str(file)])
    assert done.exit_code == 2 and file.read_bytes() == no_units()


@pytest.mark.shared_data
def test_the_citation_s_draft_names_what_the_shipped_recorder_maps():
    found = draft(sniff(str(shared_data("c550_jt15d/flight_ref.csv"))))
    shipped = load_recorder(REPOSITORY / "configs" / "recorders" / "citation_jt15d.yaml")
    guessed = {g.target: (source, g.unit) for source, g in found.columns.items()}
    for channel in shipped.channels:
        assert guessed[channel.target] == (channel.source, channel.unit)
    assert found.engines == {"left": "lh", "right": "rh"}


@pytest.mark.shared_data
@pytest.mark.parametrize(
    "file", ["uci_gas_turbine/gt_2011.csv", "amt_olympus/bench.csv", "naval_gas_turbine/states.csv"]
)
def test_public_recordings_are_drafted_and_the_drafts_read_them(tmp_path, file):
    _, recordings = drafted(tmp_path, shared_data(file).read_bytes())
    assert all(len(r) > 100 for r in recordings)


def test_a_quantity_is_that_of_the_one_part_of_the_engine_that_has_it():
    targets = ("reduction_gear_torque_N_m", "power_turbine_power_W", "fan_power_W", "Wf_kg_s")
    assert target_of("Torque", targets) is not None and target_of("Torque", targets)[0] == "reduction_gear_torque_N_m"
    assert target_of("shaft power", targets) is None  # of which of the two
