"""A judged recording has its own offsets of outputs and inputs, as large as those between the healthy ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.detection.verdict import HEALTHY, judge
from enginediag_cli.engine.instrument_errors import InputErrors
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.nominal_file import read_nominal, write_nominal
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.monitor import monitor_from_nominal
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.reduced import ReducedMonitor, reduce_monitor
from enginediag_cli.residuals.windows import WindowPlan
from enginediag_cli.validation.trial_flights import draw_flights
from enginediag_cli.validation.truth_instruments import draw_instruments

ENGINE = Path(__file__).parents[2] / "configs" / "turbojet.yaml"
JUDGED = 4


@pytest.fixture(scope="module")
def engine():
    return load_engine(ENGINE)


@pytest.fixture(scope="module")
def flown(engine):
    """Flights with offsets of all instruments: six healthy ones, and JUDGED more that are as healthy."""
    rng = np.random.default_rng(12)
    flights = [draw_flights(engine, rng)[0][0] for _ in range(6 + JUDGED)]
    for f in flights:  # a day as all others: what an unusual one does is another question
        f["dT_isa_K"] = np.full_like(f["dT_isa_K"], 3.0 * rng.standard_normal())
    instruments = draw_instruments(engine, len(flights), rng)
    found = []
    for k, f in enumerate(flights):
        p = engine.predict({c: f[c] for c in engine.inputs}, {})
        columns = {**f, **dict(zip(p.columns, p.y.T, strict=True))}
        read = instruments.read(k, columns)
        for c, s in engine.sensors.items():
            read[c] = read[c] + s.noise_sigma * rng.standard_normal(len(f["time_s"]))
        found.append({c: read[c] for c in ("time_s", *engine.inputs, *engine.sensors)})
    return found


def nominal_of(engine, flown, **more):
    recordings = [TrainingRecording(f"f{k}", f) for k, f in enumerate(flown[:6])]
    result = identify(engine, recordings, cross_validation=False, **more)
    assert result.converged, result.reason
    return result.nominal("turbojet.yaml", "0", {})


@pytest.fixture(scope="module")
def nominal(engine, flown):
    return nominal_of(engine, flown)


def verdicts(engine, nominal, flown):
    monitor = reduce_monitor(monitor_from_nominal(InputErrors.wrap(engine), nominal))
    for k, f in enumerate(flown[6:]):
        n = len(f["time_s"])
        recording = Recording(f, {"flight": ["1"] * n}, line=np.arange(2, n + 2), source=f"judged {k}")
        (window,) = window_statistics(monitor, [recording], WindowPlan())
        yield judge(window, 1e-3)


def test_a_null_recording_with_its_own_offsets_raises_no_alarm(engine, nominal, flown):
    assert [v.verdict for v in verdicts(engine, nominal, flown)] == [HEALTHY] * JUDGED
    # which it does where nobody allows for them
    trusting = nominal_of(engine, flown, offsets=False)
    assert sum(v.verdict != HEALTHY for v in verdicts(engine, trusting, flown)) >= JUDGED / 2


def test_offsets_of_inputs_act_as_the_inputs_do(engine, flown):
    nominal = nominal_of(engine, flown, map_accuracy=0.0)  # errors of maps stay as they are where an input is wrong
    monitor = monitor_from_nominal(engine, nominal)
    inputs = {c: flown[0][c][:5] for c in engine.inputs}
    _, J, _, _ = monitor.predict(inputs, monitor.theta0)
    of_inputs = [o for o in nominal.offsets if o.sensor in engine.inputs]
    assert {o.sensor for o in of_inputs} == set(engine.inputs)
    for o in of_inputs:
        step = o.prior_sigma
        by = inputs[o.sensor] if o.kind == "scale" else np.ones(5)
        y = [monitor.predict({**inputs, o.sensor: inputs[o.sensor] + d * by}, monitor.theta0)[0] for d in (-step, step)]
        column = J[:, :, monitor.names.index(f"offset.{o.sensor}.{o.kind}")]
        expected = (y[0] - y[1]) / (2 * step)
        assert column == pytest.approx(expected, rel=0.01, abs=0.01 * np.abs(expected).max())


def test_a_reduced_monitor_keeps_offsets_apart_from_what_all_recordings_share(engine, nominal, flown):
    monitor = monitor_from_nominal(engine, nominal)
    few = reduce_monitor(monitor)
    assert isinstance(few, ReducedMonitor)
    assert few.offsets == monitor.offsets and few.names[-len(few.offsets) :] == monitor.names[-len(few.offsets) :]
    inputs = {c: flown[0][c][:8] for c in engine.inputs}
    (y, J, _, _), (y2, J2, _, _) = (m.predict(inputs, m.theta0) for m in (monitor, few))
    assert y2 == pytest.approx(y)
    weight = 1 / monitor.noise.sigma
    whole = (J @ monitor.uncertainty @ np.swapaxes(J, 1, 2)) * weight[:, None] * weight
    reduced_to = (J2 @ few.uncertainty @ np.swapaxes(J2, 1, 2)) * weight[:, None] * weight
    assert reduced_to == pytest.approx(whole, abs=2e-2 * np.abs(whole).max())


def test_the_nominal_file_holds_sizes_and_what_they_rest_on(nominal, tmp_path):
    path = tmp_path / "nominal.yaml"
    write_nominal(replace(nominal, smooth=False), str(path))
    again = read_nominal(path)
    assert again.offsets == nominal.offsets
    assert {o.recordings for o in again.offsets} == {6}
    assert again.recording_offsets.keys() == nominal.recording_offsets.keys()
