"""Engines, operating points and differences that the tests of the engine share."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from enginediag_cli.config.validate import default_value
from enginediag_cli.engine.components import COMPONENTS
from enginediag_cli.engine.dual import Dual, value
from enginediag_cli.engine.evaluation import Evaluation, Flow, Shaft
from enginediag_cli.engine.gas import DRY_AIR, Gas, Mixture
from enginediag_cli.physics.engine_file import load_engine

CONFIGS = Path(__file__).parents[2] / "configs"
TURBOFAN = CONFIGS / "turbofan.yaml"
GAS = Gas()


@lru_cache(maxsize=1)
def turbofan():
    return load_engine(TURBOFAN)


def operating_points(engine, n, seed, *, altitude=(0.0, 12000.0), mach=(0.0, 0.85), dT=(-20.0, 20.0), power=(0.0, 1.0)):
    """Inputs (n,) drawn uniformly over an engine's flight envelope and corrected power range."""
    rng = np.random.default_rng(seed)
    U = {"altitude_m": rng.uniform(*altitude, n), "mach": rng.uniform(*mach, n), "dT_isa_K": rng.uniform(*dT, n)}
    U[engine.power_setting] = engine.power_from_fraction(rng.uniform(*power, n), U)
    return U


def take(inputs, at):
    return {c: np.asarray(v)[at] for c, v in inputs.items()}


def fourth_order(f, step):
    """df/dt at t = 0 from f(-2h), f(-h), f(h), f(2h): error O(h⁴)."""
    return (f(-2 * step) - 8 * f(-step) + 8 * f(step) - f(2 * step)) / (12 * step)


def seeds(*values):
    """Duals of arrays (N,), the k-th one along direction k."""
    made = []
    for k, v in enumerate(values):
        v = np.atleast_1d(np.asarray(v, dtype=float))
        d = np.zeros((k + 1, v.size))
        d[k] = 1.0
        made.append(Dual(v, d))
    return made


def gradient(x, directions):
    """Derivatives (directions, N) of a value; zero along directions that it does not carry."""
    n = np.size(value(x))
    out = np.zeros((directions, n))
    if isinstance(x, Dual):
        out[: len(x.d)] = x.d
    return out


def component(kind, **values):
    """A component as the loader makes it, with the declared defaults filled in."""
    filled = {"name": kind}
    for f in COMPONENTS[kind].SECTION.fields:
        if not f.required:
            filled[f.name] = default_value(f)
        if f.kind == "section" and values.get(f.name):
            values[f.name] = _filled(f.section, values[f.name])
        if f.kind == "sections" and values.get(f.name):
            values[f.name] = [_filled(f.section, given) for given in values[f.name]]
    return COMPONENTS[kind]({**filled, "directory": ".", **values})


def _filled(section, given):
    return {**{g.name: default_value(g) for g in section.fields if not g.required}, **given}


def evaluation(parts, *, size=1, wrt=(), **leaves):
    """A pass whose leaves are the nominal parameters, neutral positions and start values of components, and what is
    given."""
    given: dict = {}
    for part in parts:
        given |= {a.name: a.neutral for a in part.actuators()}
        given |= {p.name: p.nominal for p in part.parameters()}
        given |= {u.name: np.full(size, u.start) for u in part.unknowns()}
    given |= {k.replace("__", "."): v for k, v in leaves.items()}
    return Evaluation(GAS, size, given, frozenset(wrt))


def flow(T, P, W=1.0, far=None, war=None, gas=GAS):
    """A flow of arrays (N,) at total temperature T [K] and pressure P [Pa]."""
    T, P, W, far, war = (None if x is None else np.atleast_1d(np.asarray(x, dtype=float)) for x in (T, P, W, far, war))
    return Flow(gas, DRY_AIR if far is None and war is None else Mixture(far, war), W, P, T=T)


def shaft(rpm):
    return Shaft(np.atleast_1d(np.asarray(rpm, dtype=float)))


__all__ = [
    "CONFIGS",
    "GAS",
    "TURBOFAN",
    "component",
    "evaluation",
    "flow",
    "fourth_order",
    "gradient",
    "operating_points",
    "seeds",
    "shaft",
    "take",
    "turbofan",
]
