"""The effect of an uncertain nominal from a fit instead of from the engine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from toy_engine import ToyEngine, toy_monitor, toy_recording

from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.reduced import CompactMonitor, compact_monitor, curvature
from enginediag_cli.residuals.windows import WindowPlan


def seen_everywhere(monitor):
    """The monitor with an envelope that covers the toy's operating points."""
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(0, 11e3, 150), rng.uniform(0, 0.85, 150), rng.uniform(0.4, 1.2, 150)])
    envelope = replace(monitor.envelope, scale=np.array([4e3, 0.3, 0.3]), points=points, threshold=0.5)
    return replace(monitor, envelope=envelope)


def test_statistics_are_those_of_the_engine():
    exact = seen_everywhere(toy_monitor(uncertain=5.0, offset=2.0, rho=0.3))
    fitted = compact_monitor(exact)
    assert isinstance(fitted, CompactMonitor)
    fitted = replace(fitted, curvature=None)  # so that both are linearised at the same point
    recording = toy_recording(np.random.default_rng(2), 300)
    for linearise in ("nominal", "estimate"):
        one, two = (
            next(window_statistics(m, [recording], WindowPlan(), linearise=linearise)).statistics
            for m in (exact, fitted)
        )
        np.testing.assert_allclose(two.F, one.F, rtol=1e-4, atol=1e-4 * np.abs(one.F).max())
        np.testing.assert_allclose(two.s, one.s, rtol=1e-3, atol=0.02 * np.sqrt(np.diag(one.F)).min())


def test_a_certain_nominal_or_an_unknown_envelope_is_left_as_it_is():
    certain, unknown = seen_everywhere(toy_monitor()), replace(toy_monitor(uncertain=5.0), envelope=None)
    assert compact_monitor(certain) is certain and compact_monitor(unknown) is unknown


def test_what_a_linear_model_leaves_out_is_estimated_on_the_safe_side():
    monitor = toy_monitor()
    inputs = toy_recording(np.random.default_rng(3), 200).columns
    step = np.array([[0.0, -0.01, -0.006, 0.0], [0.002, 0.0, 0.0, -0.003]])
    found = curvature(monitor, {c: inputs[c] for c in monitor.engine.inputs}).neglected_error(step, np.array([200, 50]))
    for delta, n, estimate in zip(step, (200, 50), found, strict=True):
        u = {c: inputs[c][:n] for c in monitor.engine.inputs}
        y0, J, *_ = monitor.predict(u, monitor.theta0)
        y1, *_ = monitor.predict(u, monitor.theta0 + delta)
        missed = np.sqrt(np.sum(((y1 - y0 - J @ delta) / monitor.noise.sigma) ** 2))
        assert missed < estimate < 3 * missed


def test_a_window_stays_at_nominal_only_while_the_engine_is_nearly_linear_there():
    asked = []

    class Counting(ToyEngine):
        def predict(self, inputs, parameters=None, **options):
            asked.append(len(next(iter(inputs.values()))))
            return super().predict(inputs, parameters, **options)

    monitor = compact_monitor(replace(seen_everywhere(toy_monitor(uncertain=5.0)), engine=Counting()))
    passes = {}
    for name, change in (("healthy", {}), ("faulty", {"hpc.efficiency": -0.02})):
        asked.clear()
        next(window_statistics(monitor, [toy_recording(np.random.default_rng(4), 50, change=change)], WindowPlan()))
        passes[name] = len(asked)
    assert passes["healthy"] == 1 < passes["faulty"]
