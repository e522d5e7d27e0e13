"""How often each effect is drawn: one that identification absorbs at any size tells little more than a null trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.identified import NO_HYPOTHESIS, Identified, identify_with, nuisance
from enginediag_cli.mismatch.fit.load import Asked, build_evidence
from enginediag_cli.mismatch.fit.options import effect_option, option_scores
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import candidates
from enginediag_cli.validation.blind.flights import draw_flights, hour_columns, stack

SELDOM = 0.1
"""Weight of an effect whose λ, at the largest size that is drawn, is below 25 on a set of flights with exact maps."""

VISIBLE = 25.0
"""λ from which a cause counts as visible: five standard deviations."""


def drawable(engine: Engine) -> list[Effect]:
    """Every term at every site that can act on this engine with what its recordings hold."""
    known = {*engine.inputs, *engine.optional_inputs, *hour_columns()}
    return [e for e in candidates(engine) if set(e.term.INPUTS) <= known]


@lru_cache(maxsize=4)
def weights(path: str, largest: float) -> dict[str, float]:
    """Label of each drawable effect of the engine file → weight; `largest`: largest size drawn, over the typical."""
    engine = load_engine(path)
    library = drawable(engine)
    flights, training = draw_flights(engine, np.random.default_rng(0))
    found = noise_free_fit(engine, flights[:training], 0.0)
    result = {}
    for s in option_scores(found, Projection(found), [effect_option(e) for e in library]):
        first = s.option.hypothesis.effects[0].term.amplitudes()[0]
        size = largest * (first.typical - first.absent)
        result[s.option.label] = 1.0 if (s.score.length * size) ** 2 >= VISIBLE else SELDOM
    return result


def noise_free_fit(
    engine: Engine,
    flights: Sequence[Mapping[str, np.ndarray]],
    model_error: float,
    read: np.ndarray | None = None,
) -> Identified:
    """The engine as its file says, flown without noise and fitted. `read` (N, m): what its sensors read instead, over
    all flights, where the truth is another engine."""
    recorded, first = [], 0
    for j, f in enumerate(flights):
        if read is None:
            p = engine.predict({c: f[c] for c in engine.inputs})
            y = np.where(p.ok[:, None], p.y, np.nan)
        else:
            y = read[first : first + len(f["time_s"])]
            first += len(y)
        recorded.append(Flight(f"flight_{j + 1}", "", {**f, **dict(zip(engine.sensors, y.T, strict=True))}))
    evidence = build_evidence(engine, recorded, Asked(model_error=model_error, drivers=hour_columns()))
    return identify_with(evidence, NO_HYPOTHESIS, nuisance(evidence))


def true_readings(
    truth: Engine, flights: Sequence[Mapping[str, np.ndarray]], theta: Mapping[str, float | np.ndarray]
) -> np.ndarray:
    """What an engine's sensors read without noise over all flights (N, m), NaN where it has no solution."""
    u = stack(flights)
    p = truth.predict({c: u[c] for c in (*truth.inputs, *truth.optional_inputs) if c in u}, theta)
    return np.where(p.ok[:, None], p.y, np.nan)
