"""Flights of the shipped turbofan with effects that no column shows, for tests of the search for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight, Noise, Settings
from enginediag_cli.mismatch.fit.projection import DenseRows
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect
from enginediag_cli.shipped import shipped


@cache
def turbofan() -> Engine:
    return load_engine(shipped("turbofan.yaml"))


def carried(*wanted: tuple[str, str, Mapping[str, float]]) -> list[Effect]:
    return [effect(turbofan(), *w) for w in wanted]


def flights(
    effects: Sequence[Effect],
    rng: np.random.Generator,
    *,
    count: int = 5,
    records: int = 60,
    rho: float = 0.0,
    noise: float = 1.0,
) -> tuple[Flight, ...]:
    """Climbs and cruises with health N(1, 0.5 %) and scale errors N(1, 0.1 %), the same in all flights."""
    engine = turbofan()
    truth = engine.replace_effects(list(effects))
    theta = {n: 1 + 0.005 * rng.standard_normal() for n in engine.monitored}
    theta |= {f"sensor.{s.quantity}.scale": 1 + 0.001 * rng.standard_normal() for s in engine.sensors.values()}
    found = []
    for k in range(count):
        altitude = np.where(
            rng.uniform(size=records) < 0.4,
            rng.uniform(1500, 9000, records),
            rng.uniform(6500, 11500) + rng.normal(0, 200, records),
        )
        columns = {
            "altitude_m": altitude,
            "mach": 0.35 + 0.45 * altitude / 11500 + rng.normal(0, 0.02, records),
            "dT_isa_K": np.full(records, rng.normal(0, 8)),
        }
        columns["Wf_kg_s"] = engine.power_from_fraction(rng.uniform(0.35, 0.95, records), columns)
        p = truth.predict(columns, theta)
        assert p.ok.all()
        for j, c in enumerate(p.columns):
            e = rng.standard_normal(records)
            for i in range(1, records if rho else 0):
                e[i] = rho * e[i - 1] + np.sqrt(1 - rho**2) * e[i]
            columns[c] = p.y[:, j] + noise * engine.sensors[c].noise_sigma * e
        found.append(Flight(f"flight {k + 1}", "", columns))
    return tuple(found)


def evidence(recorded: Sequence[Flight], *, rho: float = 0.0, **settings: object) -> Dataset:
    engine = turbofan()
    nuisance = {n: 0.02 for n in engine.monitored}
    nuisance |= {f"sensor.{s.quantity}.scale": 0.002 for s in engine.sensors.values()}
    noise = Noise({c: s.noise_sigma for c, s in engine.sensors.items()}, {c: rho for c in engine.sensors})
    chosen = {"map_accuracy": 0.0, **settings}
    return Dataset(engine, tuple(recorded), noise, Settings(nuisance, **chosen))  # type: ignore[arg-type]


class WholeRows:
    """`Q` (n + k, k), `R` and `e` (n + k,) of all whitened rows at once, the priors' last."""

    def __init__(self, projection):
        dense, keep = DenseRows(projection), projection.frame.keep
        self.Q, self.R = np.concatenate([dense.rows[keep], dense.priors]), dense.R
        self.e = np.concatenate([dense.e[keep], dense.e_priors])
