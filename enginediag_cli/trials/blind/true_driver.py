"""What a concealed effect truly varies with, in the records of a trial: to judge the driver that was located."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from enginediag_cli.drivers import SAME
from enginediag_cli.engine.atmosphere import standard_atmosphere
from enginediag_cli.engine.components.ambient import Ambient
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.components.splitter import Splitter
from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.fit.evidence import Evidence
from enginediag_cli.mismatch.fit.identified import drivers_of, inputs_of
from enginediag_cli.physics.terms.humidity import saturated_water

UNDRIVEN = ("constant", "switch")
"""Words of effects that need not vary with anything."""


def driver_is_right(evidence: Evidence, health: Mapping[str, float], word: str, named: str) -> bool | None:
    """Whether these records cannot tell the driver of that name from what `word` stands for; None where the word
    stands for nothing that varies here."""
    engine = evidence.engine
    inputs, theta = inputs_of(evidence), {n: v for n, v in health.items() if n in engine.parameters}
    found = drivers_of(evidence, theta)
    values = {d.name: d.values for d in found}
    true = [d.values for d in found if d.word == word] or _others(engine, inputs, theta, word)
    if word in UNDRIVEN or not true:
        return None
    if named not in values:
        return False
    return any(_correlation(values[named], t) > SAME for t in true)


def _others(
    engine: Engine, inputs: Mapping[str, np.ndarray], theta: Mapping[str, float], word: str
) -> list[np.ndarray]:
    """Values of the words that the search itself does not try."""
    components = engine.network.components
    if word == "compressor_pressure":
        last = [c for c in components if isinstance(c, Compressor)][-1]
        return _predicted(engine, inputs, theta, f"P{last.values['to']}_Pa")
    if word == "bypass_ratio":
        for c in components:
            if isinstance(c, Splitter):
                (core,) = _predicted(engine, inputs, theta, f"W{c.values['core']}_kg_s")
                (bypass,) = _predicted(engine, inputs, theta, f"W{c.values['bypass']}_kg_s")
                return [bypass / core]
    if word == "humidity" and any(isinstance(c, Ambient) for c in components) and "altitude_m" in inputs:
        T, p = standard_atmosphere(inputs["altitude_m"])
        return [np.asarray(saturated_water(T + inputs["dT_isa_K"], p))]
    return []


def _predicted(
    engine: Engine, inputs: Mapping[str, np.ndarray], theta: Mapping[str, float], column: str
) -> list[np.ndarray]:
    p = engine.predict(inputs, theta, sensors=(column,))
    return [np.where(p.ok, p.y[:, 0], np.nan)]


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    good = np.isfinite(a) & np.isfinite(b)
    return abs(float(np.corrcoef(a[good], b[good])[0, 1]))
