"""Small concealed recordings of the default turbofan for the tests of explain and refine."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
from enginediag_cli.mismatch.fit.load import MismatchQuery, build_dataset
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect

ENGINE = Path(__file__).parents[2] / "configs" / "turbofan.yaml"


@lru_cache(maxsize=1)
def engine() -> Engine:
    return load_engine(str(ENGINE))


def flights(
    label: str, values: dict[str, float], *, count: int = 7, records: int = 40, seed: int = 0, switch: float = 0.0
) -> tuple[list[Flight], np.ndarray]:
    """Flights flown by an engine with an effect (`term@site`, "" for none), and its state (records,) in each record:
    always on, or changing with the probability `switch`."""
    e, rng = engine(), np.random.default_rng(seed)
    truth = e if not label else e.replace_effects([effect(e, *label.split("@"))])
    worn = {n: 1.0 + 0.005 * rng.standard_normal() for n in e.monitored}
    found, states = [], []
    for k in range(count):
        h = rng.uniform(0, 11500, records)
        u = {
            "altitude_m": h,
            "mach": 0.25 + 0.5 * h / 12000 + rng.normal(0, 0.02, records),
            "dT_isa_K": np.full(records, rng.normal(0, 8)),
        }
        u["Wf_kg_s"] = e.power_from_fraction(rng.uniform(0.5, 1.0, records), u)
        on = np.cumsum(rng.random(records) < switch) % 2 if switch else np.ones(records)
        coefficients = {f"{label.replace('@', '.')}.{n}": v * on for n, v in values.items()}
        y = truth.predict(u, {**worn, **coefficients})
        assert y.ok.all()
        columns = {
            c: y.y[:, j] + e.sensors[c].noise_sigma * rng.standard_normal(records) for j, c in enumerate(y.columns)
        }
        found.append(Flight(f"flight {k + 1}", "", {**u, **columns}))
        states.append(on)
    return found, np.concatenate(states)


def evidence(found: list[Flight], model_error: float = 0.003) -> Dataset:
    return build_dataset(engine(), found, MismatchQuery(model_error=model_error))


def library(*labels: str) -> list:
    return [effect(engine(), *label.split("@")) for label in labels]


def write_csv(found: list[Flight], path: Path) -> None:
    """The flights as one recording."""
    rows = ["flight," + ",".join(found[0].columns)]
    for k, f in enumerate(found):
        rows += [f"{k + 1}," + ",".join(f"{x:.10g}" for x in r) for r in zip(*f.columns.values(), strict=True)]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
