"""What remembers, drawn for blind trials of kind dynamic: rate limits, lags, delays, heat soak, inertia.

The kind of effect is drawn first and its place after that: an engine has more probes than fuel controls. Sizes are in
seconds that recordings of some minutes at 1 Hz can show; a rotor's inertia is drawn as the time in which its whole
design power would bring it to speed, since kilogram metres squared of a model jet say nothing about a fan.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.moving.tape import MOMENT
from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.physics.registry import candidates
from enginediag_cli.physics.terms.clock_shift import ClockShift
from enginediag_cli.physics.terms.fuel_control_lag import FuelControlLag
from enginediag_cli.physics.terms.fuel_rate_limit import FuelRateLimit
from enginediag_cli.physics.terms.heat_soak import HeatSoak
from enginediag_cli.physics.terms.load_control_delay import LoadControlDelay
from enginediag_cli.physics.terms.load_control_lag import LoadControlLag
from enginediag_cli.physics.terms.load_rate_limit import LoadRateLimit
from enginediag_cli.physics.terms.load_second_order_lag import LoadSecondOrderLag
from enginediag_cli.physics.terms.probe_lag import ProbeLag
from enginediag_cli.physics.terms.rotor_inertia import RotorInertia
from enginediag_cli.units import RAD_S_PER_RPM

SIZES: Mapping[str, Mapping[str, tuple[float, float]]] = MappingProxyType(
    {
        FuelRateLimit.NAME: {"rise": (4.0, 20.0), "fall": (4.0, 20.0)},
        FuelControlLag.NAME: {"time_constant": (0.7, 5.0)},
        LoadRateLimit.NAME: {"rise": (15.0, 120.0), "fall": (15.0, 120.0)},
        LoadControlLag.NAME: {"time_constant": (3.0, 30.0)},
        LoadSecondOrderLag.NAME: {"time_constant": (5.0, 30.0), "second_share": (0.25, 0.5)},
        LoadControlDelay.NAME: {"delay": (3.0, 25.0)},
        ProbeLag.NAME: {"time_constant": (1.5, 12.0)},
        ClockShift.NAME: {"delay": (0.7, 8.0)},
        HeatSoak.NAME: {"exchange": (0.015, 0.08), "time_constant": (8.0, 120.0)},
    }
)
"""Coefficients by effect, from and to, evenly in the logarithm. Judgement within the ranges that the effects state."""
ACCELERATION_S = (1.0, 8.0)
"""I ω²/P at the design point of a shaft, from and to: Walsh and Fletcher, Gas Turbine Performance, ch. 8, spools from
idle to rating in some seconds."""
EITHER_SIGN = (ClockShift.NAME,)
"""Effects that are drawn with both signs: a clock may be ahead."""


def drawable_memories(engine: Engine) -> list[Effect]:
    """Every effect with memory that can be concealed here: of inertias only that of the rotor whose speed sets the
    power. Another's speed is held, or follows from its inertia record by record: a simulation in time, not a tape."""
    found = [e for e in candidates(engine) if MOMENT in e.term.INPUTS]
    driven = engine.network.speed_columns.get(engine.power_setting)
    return [e for e in found if not isinstance(e.term, RotorInertia) or e.site.name == driven]


def draw_memories(engine: Engine, count: int, rng: np.random.Generator) -> tuple[tuple[Effect, ...], dict[str, float]]:
    """So many effects of different kinds, and their coefficients by parameter; nothing is drawn for none."""
    library = drawable_memories(engine)
    kinds = list(dict.fromkeys(e.term.NAME for e in library))
    effects: list[Effect] = []
    values: dict[str, float] = {}
    for k in rng.choice(len(kinds), count, replace=False) if count else ():
        own = [e for e in library if e.term.NAME == kinds[int(k)]]
        effect = own[int(rng.integers(len(own)))]
        effects.append(effect)
        for c in effect.term.amplitudes():
            values[effect.parameter_name(c.name)] = _size(engine, effect, c, rng)
    return tuple(effects), values


def _size(engine: Engine, effect: Effect, c: Coefficient, rng: np.random.Generator) -> float:
    if isinstance(effect.term, RotorInertia):
        assert engine.network.design_point is not None
        shaft = engine.network.design_point.shafts[effect.site.name]
        omega = RAD_S_PER_RPM * scalar(shaft.speed_rpm)
        return _between(*ACCELERATION_S, rng) * scalar(shaft.supply_W) / omega**2
    # of an effect that this file does not know, the size that it calls typical
    low, high = SIZES.get(effect.term.NAME, {}).get(c.name, (0.5 * c.typical, c.typical))
    sign = rng.choice((-1.0, 1.0)) if effect.term.NAME in EITHER_SIGN else 1.0
    return float(np.clip(sign * _between(low, high, rng), c.lower, c.upper))


def _between(low: float, high: float, rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
