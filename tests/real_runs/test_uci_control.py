"""The power plant's unrecorded guide vanes: what holds the exhaust temperature is found in 2011 and holds in 2012."""

from __future__ import annotations

import pytest
from ground_recordings import CONFIGS, public_data

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.mismatch.controlled.find import ControlSearchResult, find_law
from enginediag_cli.mismatch.refine.controlled import refine_control
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.recorder_file import load_recorder

pytestmark = [pytest.mark.shared_data, pytest.mark.slow]
WITHHELD = ("relative_humidity", "humidity_kg_kg")


@pytest.fixture(scope="module")
def plant() -> tuple[EngineDescription, Engine]:
    engine = load_engine(CONFIGS / "power_plant.yaml")
    return EngineDescription.from_engine_file(engine.path, engine.declared), engine


def year(number: int) -> TrainingRecording:
    """Steady hours, humidity withheld."""
    recorder = load_recorder(CONFIGS / "recorders" / "uci_gas_turbine.yaml")
    [mapped] = recorder.read(public_data("uci_gas_turbine") / f"gt_{number}.csv")
    columns = {c: mapped.recording[c] for c in mapped.recording.columns if c not in WITHHELD}
    return TrainingRecording(str(number), columns)


@pytest.fixture(scope="module")
def found(plant: tuple[EngineDescription, Engine]) -> ControlSearchResult:
    law = find_law(*plant, [year(2011)])
    assert law is not None
    return law


def test_guide_vanes_hold_the_exhaust_at_550_degrees_until_they_are_open(found: ControlSearchResult) -> None:
    law = found.best.law
    assert (law.actuator.name, law.hold) == ("compressor.vane_closing_deg", "T5_K")
    assert law.set_point == pytest.approx(823.15, abs=0.1)
    assert law.enabled is not None and law.enabled.column == "T4_K" and 1368 < law.enabled.value < 1373
    assert found.held == pytest.approx(0.64, abs=0.02)


def test_that_they_hold_the_power_instead_is_plainly_worse(found: ControlSearchResult) -> None:
    assert not found.rivals
    [power] = [t for t in found.worse if t.law.hold == "power_W"]
    assert power.gain < 0.5 * found.best.gain


def test_2012_is_predicted_at_part_load_and_in_base_load(
    plant: tuple[EngineDescription, Engine], found: ControlSearchResult
) -> None:
    r = refine_control(found, *plant, [year(2011)], [year(2012)])
    assert r.accepted and r.runs == 1.0
    after = {(q.sensor, q.regime): q.rms for q in r.after}
    assert after["T5_K", "held"] < 0.3 and after["P3_Pa", "held"] < 0.9 and after["power_W", "held"] < 1.2
    # open vanes: they wander, and TIT is computed without the barometer
    assert after["T5_K", "released"] < 3.6 and after["P3_Pa", "released"] < 1.7 and after["power_W", "released"] < 1.7
