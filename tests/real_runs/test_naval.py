"""A naval gas generator whose decay is known: identified on healthy states, and every decayed state isolated.

The recording is a simulator's, without noise. Its gas generator has variable stators that the model does not have,
so that the shaft speed is missed by some 400 rpm; only the three highest lever positions (10 MW and more) are used.
No sensor of a simulator is wrong; where isolation is not said so, it may not be sure of what cannot be.
"""

from __future__ import annotations

import csv

import pytest
from ground_recordings import CONFIGS, enginediag, public_data, table

from enginediag_cli.identification.nominal_file import read_nominal

ENGINE = CONFIGS / "naval_gas_generator.yaml"
RECORDER = CONFIGS / "recorders" / "naval_gas_turbine.yaml"
HIGH_LEVER = 7.0

pytestmark = [pytest.mark.shared_data, pytest.mark.slow]


def decay(row):
    return float(row["kMc"]), float(row["kMt"])


def write(path, rows):
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return path


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    """Folder with high.csv (all states above 10 MW), healthy.csv and nominal.yaml identified on it."""
    folder = tmp_path_factory.mktemp("naval")
    with (public_data("naval_gas_turbine") / "states.csv").open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if float(row["lp"]) > HIGH_LEVER]
    write(folder / "high.csv", rows)
    write(folder / "healthy.csv", [row for row in rows if min(decay(row)) >= 0.998])
    enginediag("identify", ENGINE, folder / "healthy.csv", "--recorder", RECORDER, "-o", folder / "nominal.yaml")
    return folder


def asked(row):
    """Healthy states; every second one with one part decayed, every third with both."""
    c, t = decay(row)
    number = round(1000 * (c + t))
    if c >= 0.992 and t >= 0.996:
        return True
    if c <= 0.97 and t <= 0.985:
        return number % 3 == 0
    return number % 2 == 0 and ((c <= 0.97 and t >= 0.996) or (c >= 0.992 and t <= 0.985))


@pytest.fixture(scope="module")
def answers(plant):
    """One answer per state that is `asked` for: (compressor decay, turbine decay, verdict, set of components,
    probability)."""
    with (plant / "high.csv").open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if asked(row)]
    write(plant / "asked.csv", rows)
    out, _ = enginediag(
        "isolate",
        "-n",
        plant / "nominal.yaml",
        plant / "asked.csv",
        "--recorder",
        RECORDER,
        "--window",
        "3",
        "--by",
        "component",
    )
    states = [(decay(rows[int(r["first_line"]) - 2]), r) for r in table(out)]
    return [
        (*kappa, r["verdict"], frozenset(r["components"].split("; ")) - {""}, float(r["probability"]))
        for kappa, r in states
    ]


def share(answers, chosen, right):
    among = [a for a in answers if chosen(a[0], a[1])]
    assert len(among) >= 20
    return sum(right(a) for a in among) / len(among)


def test_the_recording_is_of_pressures_in_bar_and_of_power_as_torque_times_speed(plant):
    """Full lever: 22.5 bar behind the compressor, 27 MW; the heat balance then gives some 85 kg/s of air."""
    nominal = read_nominal(plant / "nominal.yaml")
    quality = {q.sensor: q.rms for q in nominal.cross_validated if q.regime == "all"}
    assert quality["P3_Pa"] < 2.5
    assert quality["P45_Pa"] < 0.6
    assert quality["power_W"] < 5.0
    assert quality["T45_K"] < 4.0


def test_healthy_states_are_called_healthy(answers):
    assert share(answers, lambda c, t: c >= 0.992 and t >= 0.996, lambda a: a[2] == "healthy") >= 0.95


def test_a_decayed_compressor_is_isolated_to_the_compressor(answers):
    right = share(answers, lambda c, t: c <= 0.97 and t >= 0.996, lambda a: a[2] == "fault" and a[3] == {"compressor"})
    assert right >= 0.9


def test_a_decayed_turbine_is_isolated_to_the_gas_generator_turbine(answers):
    right = share(
        answers, lambda c, t: c >= 0.992 and t <= 0.985, lambda a: a[2] == "fault" and a[3] == {"gas_generator_turbine"}
    )
    assert right >= 0.95


BOTH = {"compressor", "gas_generator_turbine"}


def test_where_both_decay_both_are_named_and_no_third_one_surely(answers):
    """Three records of each state, and maps wrong by several per cent."""
    assert share(answers, lambda c, t: c <= 0.97 and t <= 0.985, lambda a: BOTH <= a[3]) >= 0.75
    assert share(answers, lambda c, t: c <= 0.97 and t <= 0.985, lambda a: a[3] <= BOTH or a[4] < 0.7) >= 0.95


def test_where_both_decay_the_power_turbine_is_not_named_beside_them(answers):
    """At its old speed and power its inlet is 3 % hotter, as if it gave less: its map may be wrong by as much, so that
    it is about as probable as it was before the data, and is told as perhaps changed."""
    assert share(answers, lambda c, t: c <= 0.97 and t <= 0.985, lambda a: bool(a[3]) and a[3] <= BOTH) >= 0.95


def lost_efficiency(rows, healthy):
    """Share of compressor efficiency lost between states at the same lever, from its temperatures and pressures."""

    def ideal_over_real(row):
        ratio = float(row["P2"]) / float(row["P1"])
        return float(row["T1"]) * (ratio ** (1 / 3.5) - 1) / (float(row["T2"]) - float(row["T1"]))

    before = {row["lp"]: ideal_over_real(row) for row in healthy if decay(row) == (1.0, 1.0)}
    return sum(1 - ideal_over_real(row) / before[row["lp"]] for row in rows) / len(rows)


@pytest.mark.parametrize(("sensors", "least"), [("--no-sensors", 0.99), ("--sensors", 0.9)])
def test_of_the_most_decayed_compressor_the_loss_of_efficiency_is_that_of_its_temperatures_and_pressures(
    plant, tmp_path, sensors, least
):
    """The 18 records of the largest decay; whether its flow or a neighbour changed, too, is left open. T3 rises by
    2.2 %: an instrument that may be wrong by 1 % (1 standard deviation) is another explanation, a tenth at most."""
    with (plant / "high.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    worst = [row for row in rows if decay(row)[0] <= 0.952 and decay(row)[1] >= 0.998]
    file = write(tmp_path / "worst.csv", worst)
    out, _ = enginediag("isolate", "-n", plant / "nominal.yaml", file, "--recorder", RECORDER, sensors)
    row = table(out)[0]
    assert row["verdict"] == "fault" and row["isolated"] == "compressor.efficiency"
    assert float(row["inclusion"]) > least
    assert float(row["lower"]) < -lost_efficiency(worst, rows) < float(row["upper"])
