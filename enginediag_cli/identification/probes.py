"""Probes that the heat balances between stations contradict, found before any parameter is fitted to them.

Heat balances tie recorded temperatures, fuel and pressures together without a component map.
Their differences r (N, J) are zero within what stated accuracy and the engine leave open, covariance

    R_k = G_k S G_kᵀ + Q_k

with G the derivatives by the readings, S the stated accuracies squared and Q what each balance leaves open itself. A
probe is wrong when it alone, with an error of its own in every record, takes away most of the misfit rᵀR⁻¹r: with its
column of G eliminated the rest agrees. Where several probes would do that, they are one class, and nobody can say more.
The misfit is a mean over the records, never a sum: what makes a balance differ is the same in all of them.

**The balances** of recorded stations, which need no component map:

    shaft    (1 + f) (h₄ − h₅) η_m = h₃ − h₂            one spool that drives nothing else, one stream through both
    duct     T_a = T_b                                  nothing but ducts between two stations
    burner   (1 + f) h₄ − h₃ = c f η_b LHV              f from the fuel flow and the flow that the nozzle passes
    rise     h₃ − h₂ = (h₃s − h₂) / η_c                 ideal rise by the pressures, efficiency roughly that of design

Each is written as a difference in K of the gas at its hottest station. The constant c stands for everything that is the
same in all records: nozzle area, heating value, share of the heat that arrives, density of the fuel. It is free, so
that the burner's balance only shows whether temperatures and fuel go together over the operating points. The rise of a
compressor alone judges no probe, since its efficiency is not known; it says how wrong a probe behind it can be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine.components.combustion import Burner
from enginediag_cli.engine.components.nozzles import Nozzle, throat
from enginediag_cli.engine.components.passages import Bleed, Duct, Inlet
from enginediag_cli.engine.components.turbomachinery import Compressor, Turbine
from enginediag_cli.engine.dual import log, value
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.evaluation import Flow
from enginediag_cli.engine.gas import Mixture
from enginediag_cli.engine.network import OFFTAKE_SHARE
from enginediag_cli.identification.problem import TrainingRecording

FUEL = "Wf_kg_s"
SHAFT_SHARE = 0.01
"""Of a turbine's work: what bearings and gas properties leave open, beside an off-take of the usual size."""
HEAT_SHARE = 0.1
"""Of the fuel's heat: combustion at idle is that much worse than at power, in small burners most."""
EFFICIENCY_SHARE = 0.1
"""Of a compressor's rise: efficiencies from idle to full power lie that close to the one of design."""
DUCT_SHARE = 0.003
"""Of a temperature: heat that a hot duct loses over its length."""

Readings = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Balance:
    """`difference(readings)` → (N,) K, zero where the probes agree; `allowed(readings)` → (N,) K that the engine itself
    leaves open; `probes`: columns that take part; `scale(readings)` → (N,) K per unit of the constant c, or None."""

    name: str
    probes: tuple[str, ...]
    difference: Callable[[Readings], np.ndarray]
    allowed: Callable[[Readings], np.ndarray]
    scale: Callable[[Readings], np.ndarray] | None = None


def station_sensor(engine: Engine, what: str, station: str) -> str | None:
    """The sensor that reads the total temperature (what "T") or pressure ("P") of a station and nothing else."""
    column = f"{what}{station}_{'K' if what == 'T' else 'Pa'}"
    for name, sensor in engine.sensors.items():
        if dict(sensor.reads) == {column: 1.0} and sensor.denominator is None:
            return name
    return None


def balances(engine: Engine, columns: frozenset[str], model: Readings) -> list[Balance]:
    """Every balance whose probes are among `columns`; `model`: T and FAR of stations where no probe stands, as the
    engine before any fit has them, see `needed_of_model`."""
    found = [*_shafts(engine, columns, model), *_ducts(engine), *_burners(engine, columns, model)]
    found = [b for b in found if set(b.probes) <= columns]
    judged = {c for b in found for c in b.probes}
    rises = [b for b in _rises(engine, columns, model) if set(b.probes) <= columns and b.probes[0] in judged]
    return [*found, *rises]


def model_columns_needed(engine: Engine) -> tuple[str, ...]:
    """Model columns that the balances take from the engine before any fit: ambient, inlet, fuel–air ratios."""
    stations = [s for c in engine.network.components for s in (c.values.get("from"), c.values.get("to")) if s]
    inlets = [c.values["to"] for c in engine.network.components if isinstance(c, Inlet)]
    far = [f"FAR{s}" for s in dict.fromkeys(stations) if f"FAR{s}" in engine.model_columns]
    return ("P0_Pa", *(f"T{s}_K" for s in inlets), *(f"P{s}_Pa" for s in inlets), *far)


def _shafts(engine: Engine, columns: frozenset[str], model: Readings) -> Iterator[Balance]:
    net = engine.network
    for name, shaft in net.shafts.items():
        on = [c for c in net.components if c.values.get("shaft") == name]
        machines = [c for c in on if isinstance(c, Compressor)], [c for c in on if isinstance(c, Turbine)]
        if name in net.loaded_shafts or any(len(m) != 1 for m in machines):
            continue
        (compressor,), (turbine,) = machines
        hot, cold = turbine.values["from"], compressor.values["to"]
        if not _one_stream(engine, cold, hot, (Duct, Bleed, Burner)):
            continue
        T2 = _probe_or_inlet(engine, compressor.values["from"], columns, model)
        T3, T4, T5 = (station_sensor(engine, "T", s) for s in (cold, hot, turbine.values["to"]))
        if T2 is None or T3 is None or T4 is None or T5 is None:
            continue
        yield _shaft(engine, (T2, T3, T4, T5), model[f"FAR{hot}"], (name, float(shaft["mechanical_efficiency"])))


def _shaft(
    engine: Engine, probes: tuple[str | np.ndarray, str, str, str], far: np.ndarray, shaft: tuple[str, float]
) -> Balance:
    gas, burnt, bled = engine.network.gas, Mixture(far), _bled(engine)
    inlet, T3, T4, T5 = probes
    name, efficiency = shaft

    def difference(y: Readings) -> np.ndarray:
        given = (1.0 + far) * efficiency * (_h(gas, y[T4], burnt) - _h(gas, y[T5], burnt))
        taken = _h(gas, y[T3], Mixture()) - _h(gas, y[inlet] if isinstance(inlet, str) else inlet, Mixture())
        return np.asarray((given - taken) / ((1.0 + far) * efficiency * value(gas.heat_capacity(y[T4], burnt))))

    def allowed(y: Readings) -> np.ndarray:
        work = y[T3] - (y[inlet] if isinstance(inlet, str) else inlet)
        return np.asarray(np.hypot(np.hypot(SHAFT_SHARE, OFFTAKE_SHARE) * work, bled * (y[T4] - y[T3])))

    own = (inlet,) if isinstance(inlet, str) else ()
    return Balance(f"power of the {name} shaft", (*own, T3, T4, T5), difference, allowed)


def _ducts(engine: Engine) -> Iterator[Balance]:
    for c in engine.network.components:
        if not isinstance(c, (Duct, Bleed)) or c.values.get("receives"):
            continue
        one, other = (station_sensor(engine, "T", c.values[key]) for key in ("from", "to"))
        if one and other:
            yield _duct(c.name, one, other)


def _duct(name: str, one: str, other: str) -> Balance:
    return Balance(
        f"heat of the {name}", (one, other), lambda y: y[one] - y[other], lambda y: np.asarray(DUCT_SHARE * y[one])
    )


def _burners(engine: Engine, columns: frozenset[str], model: Readings) -> Iterator[Balance]:
    net = engine.network
    burners = [c for c in net.components if isinstance(c, Burner)]
    nozzles = [c for c in net.components if isinstance(c, Nozzle)]
    if len(burners) != 1 or len(nozzles) != 1 or FUEL not in columns:
        return
    burner, nozzle = burners[0], nozzles[0]
    if nozzle.actuators() or not nozzle.converges:  # its area, or what flows through it, is not known
        return
    T3, T4 = (station_sensor(engine, "T", burner.values[key]) for key in ("from", "to"))
    throat_at = nozzle.values["from"]
    T7, P7 = station_sensor(engine, "T", throat_at), station_sensor(engine, "P", throat_at)
    if T3 is None or T4 is None or T7 is None or P7 is None:
        return
    if not _one_stream(engine, burner.values["to"], throat_at, (Duct, Bleed, Turbine)):
        return
    gas, far, p0 = net.gas, model[f"FAR{burner.values['to']}"], model["P0_Pa"]
    burnt, bled = Mixture(far), _bled(engine)
    heat = burner.values["combustion_efficiency"] * burner.values["lower_heating_value_J_kg"]
    area = nozzle.reference_area_m2 * nozzle.values["discharge_coefficient"]

    def heating(y: Readings) -> np.ndarray:
        """K that the fuel makes of the gas."""
        flow = Flow(gas, burnt, 1.0, y[P7], T=y[T7])
        W = value(throat(flow, log(y[P7] / p0), p0)[0]) * area
        return np.asarray(y[FUEL] * heat / (W * value(gas.heat_capacity(y[T4], burnt))))

    def difference(y: Readings) -> np.ndarray:
        taken = (1.0 + far) * _h(gas, y[T4], burnt) - _h(gas, y[T3], Mixture())
        return np.asarray(taken / ((1.0 + far) * value(gas.heat_capacity(y[T4], burnt))) - heating(y))

    def allowed(y: Readings) -> np.ndarray:
        return np.asarray(np.hypot(HEAT_SHARE, bled) * (y[T4] - y[T3]))

    yield Balance("heat of the fuel", (T3, T4, T7, P7, FUEL), difference, allowed, heating)


def _rises(engine: Engine, columns: frozenset[str], model: Readings) -> Iterator[Balance]:
    for c in engine.network.components:
        if not isinstance(c, Compressor):
            continue
        station, behind = c.values["from"], c.values["to"]
        T2, P2 = (_probe_or_inlet(engine, station, columns, model, what) for what in ("T", "P"))
        T3, P3 = (station_sensor(engine, what, behind) for what in ("T", "P"))
        if T2 is None or P2 is None or T3 is None or P3 is None:
            continue
        yield _rise(engine, c, (T3, P3), (T2, P2))


def _rise(
    engine: Engine, c: Compressor, exit: tuple[str, str], entry: tuple[str | np.ndarray, str | np.ndarray]
) -> Balance:
    gas, (T3, P3), (T2, P2) = engine.network.gas, exit, entry

    def ideal(y: Readings) -> tuple[np.ndarray, np.ndarray]:
        """Temperature before, and behind a compressor of the design efficiency, (N,) K each."""
        T, P = (y[v] if isinstance(v, str) else v for v in (T2, P2))
        flow = Flow(gas, Mixture(), 1.0, P, T=T)
        h = value(gas.temperature_from_entropy(flow.phi + flow.R * np.log(y[P3] / P), Mixture())[1])
        h = flow.h + (h - flow.h) / c.values["isentropic_efficiency"]
        return T, np.asarray(value(gas.temperature_from_enthalpy(h, Mixture())[0]))

    def allowed(y: Readings) -> np.ndarray:
        before, behind = ideal(y)
        return np.asarray(EFFICIENCY_SHARE * (behind - before))

    own = tuple(v for v in entry if isinstance(v, str))
    return Balance(f"rise of the {c.name}", (T3, P3, *own), lambda y: y[T3] - ideal(y)[1], allowed)


def _h(gas: object, T: np.ndarray, mixture: Mixture) -> np.ndarray:
    return np.asarray(value(gas.enthalpy(T, mixture)))  # type: ignore[attr-defined]


def _bled(engine: Engine) -> float:
    """Air that leaves the main stream, or joins it again where a balance does not follow it, as a share."""
    ports = [p for c in engine.network.components for p in (c.values.get("ports") or ())]
    return float(sum(p.get("fraction") or 0.0 for p in ports))


def _probe_or_inlet(
    engine: Engine, station: str, columns: frozenset[str], model: Readings, what: str = "T"
) -> str | np.ndarray | None:
    """What says the temperature (what "T") or pressure ("P") at the entry of a compressor: its probe, or the air that
    comes through an inlet."""
    probe = station_sensor(engine, what, station)
    if probe in columns:
        return probe
    return model.get(f"{what}{station}_{'K' if what == 'T' else 'Pa'}")


def _one_stream(engine: Engine, start: str, end: str, through: tuple[type, ...]) -> bool:
    """Whether nothing but components of these kinds lies between two stations."""
    at = {c.values["from"]: c for c in engine.network.components if c.values.get("from") and c.values.get("to")}
    while start != end:
        c = at.get(start)
        if c is None or not isinstance(c, through):
            return False
        start = c.values["to"]
    return True


GROSS = 4.0
"""Standard deviations (rms over the records) by which a probe must be off before it is named: probes in a hot gas and
generic allowances are off by two or three."""
MENDED = 0.5
"""Least share of the misfit of all balances that goes with the probe; what does less is not what is wrong."""
AS_GOOD = 0.8
"""Share of the misfit taken away by the best probe that another one must take away to be as good a name."""
RECORDS = 400
"""Records that are used, evenly spread."""
FEWEST = 5
"""Records below which nothing is said."""
STEP = 1e-4
"""Relative step of the derivatives; the balances are smooth."""
PASSES = 5
"""Passes for the free constant, by weights that hold wild records down."""
FUEL_SHARE = 0.02
"""Accuracy of a fuel flow for which none is stated, as the input that sets the power."""


@dataclass(frozen=True)
class WrongProbe:
    """Columns of which one is wrong, most often one alone; numbers in that column's unit.

    `error` (low, median, high): what each record says the probe of a single column is off by, 10th to 90th percentile;
    `expected`: standard deviation of that by what is stated; `records` that were asked; `balances` that it takes part
    in; `mended`: the share of their misfit that is gone without it.
    """

    columns: tuple[str, ...]
    error: tuple[float, float, float]
    expected: float
    records: int
    balances: tuple[str, ...]
    explained_share: float

    @property
    def is_unique(self) -> bool:
        """Whether the balances say which probe it is."""
        return len(self.columns) == 1


def wrong_probes(engine: Any, recordings: Sequence[TrainingRecording]) -> tuple[WrongProbe, ...]:
    """Probes that the balances contradict, the one that explains most first; nothing where no balance is recorded
    whole. A class of several ends the list: nothing can be concluded about other probes then."""
    if not isinstance(engine, Engine):
        return ()
    columns = frozenset.intersection(*(frozenset(r.columns) for r in recordings)) if recordings else frozenset()
    known = frozenset(c for c in (*engine.sensors, FUEL) if c in columns)
    if not balances(engine, known, _missing_columns(engine)):
        return ()
    readings, model = _sample_readings(engine, recordings, known)
    if len(model["P0_Pa"]) < FEWEST:
        return ()
    return _find_wrong_probes(
        balances(engine, known, model), readings, {c: _accuracy(engine, c, readings) for c in known}
    )


def drop_probes(recordings: Sequence[TrainingRecording], columns: Sequence[str]) -> list[TrainingRecording]:
    """The recordings without these columns."""
    return [r._replace(columns={c: v for c, v in r.columns.items() if c not in columns}) for r in recordings]


def _sample_readings(
    engine: Engine, recordings: Sequence[TrainingRecording], known: frozenset[str]
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Readings, and what the model says of stations without a probe, of some records that have all of them."""
    inputs = [c for c in (*engine.inputs, *engine.optional_inputs) if all(c in r.columns for r in recordings)]
    wanted = sorted({*known, *inputs})
    stacked = {c: np.concatenate([np.asarray(r.columns[c], float) for r in recordings]) for c in wanted}
    taken = {c for b in balances(engine, known, _missing_columns(engine)) for c in b.probes}
    whole = np.flatnonzero(np.all([np.isfinite(stacked[c]) for c in {*taken, *inputs}], axis=0))
    some = whole[np.unique(np.linspace(0, len(whole) - 1, min(RECORDS, len(whole))).round().astype(int))]
    stacked = {c: v[some] for c, v in stacked.items()}
    needed = model_columns_needed(engine)
    found = engine.predict({c: stacked[c] for c in inputs}, sensors=(), also=needed)
    good = found.ok & np.isfinite(found.also).all(axis=1)
    return {c: stacked[c][good] for c in known}, {c: found.also[good, j] for j, c in enumerate(needed)}


def _missing_columns(engine: Engine) -> dict[str, np.ndarray]:
    return {c: np.full(1, np.nan) for c in model_columns_needed(engine)}


def _accuracy(engine: Engine, column: str, readings: Mapping[str, np.ndarray]) -> float:
    sensor = engine.sensors.get(column)
    return sensor.noise_sigma if sensor else FUEL_SHARE * float(np.median(readings[column]))


def _find_wrong_probes(
    given: Sequence[Balance], readings: Mapping[str, np.ndarray], sigma: Mapping[str, float]
) -> tuple[WrongProbe, ...]:
    """One probe after the other, each without those before it."""
    probes = tuple(dict.fromkeys(c for b in given for c in b.probes))
    r = np.column_stack([b.difference(readings) for b in given])
    G = np.zeros((*r.shape, len(probes)))
    for p, column in enumerate(probes):
        step = STEP * readings[column]
        moved = {**readings, column: readings[column] + step}
        for j, b in enumerate(given):
            if column in b.probes:
                G[:, j, p] = (b.difference(moved) - r[:, j]) / step
    spread = np.array([sigma[c] for c in probes])
    R = np.einsum("kjp,p,kip->kji", G, spread**2, G)
    R[:, range(len(given)), range(len(given))] += np.column_stack([b.allowed(readings) for b in given]) ** 2
    scale = np.column_stack([np.zeros(len(r)) if b.scale is None else -b.scale(readings) for b in given])
    there = np.isfinite(r).all(axis=1) & np.isfinite(R).all(axis=(1, 2))
    r, G, R, scale = r[there], G[there], R[there], scale[there]
    if len(r) < FEWEST:
        return ()
    out: list[int] = []
    found: list[WrongProbe] = []
    while True:
        before = _misfit(r, G[:, :, out], R, scale)
        left = [p for p in range(len(probes)) if p not in out]
        tried = {p: _misfit(r, G[:, :, [*out, p]], R, scale) for p in left}
        gain = {p: before - m for p, m in tried.items()}
        best = max(left, key=lambda p: gain[p], default=None)
        if best is None or not gain[best] > MENDED * before:
            return tuple(found)
        error, sd = _probe_error(r, G[:, :, out], G[:, :, best], R, scale)
        if not float(np.sqrt(np.mean((error / sd) ** 2))) > GROSS:
            return tuple(found)
        alike = sorted((p for p in left if gain[p] >= AS_GOOD * gain[best]), key=lambda p: -gain[p])
        low, middle, high = np.quantile(error, (0.1, 0.5, 0.9))
        names = tuple(probes[p] for p in alike)
        found.append(
            WrongProbe(
                names,
                (float(low), float(middle), float(high)),
                float(np.median(sd)),
                len(r),
                tuple(b.name for b in given if set(names) & set(b.probes)),
                float(gain[best] / before),
            )
        )
        if len(alike) > 1:
            return tuple(found)
        out.append(best)


def _weights(R: np.ndarray, free: np.ndarray) -> np.ndarray:
    """R⁻¹ with the directions `free` (N, J, q) eliminated, (N, J, J)."""
    W = np.linalg.inv(R)
    if free.shape[2]:
        B = W @ free
        W = W - B @ np.linalg.pinv(np.swapaxes(free, 1, 2) @ B, hermitian=True) @ np.swapaxes(B, 1, 2)
    return W


def _constant(r: np.ndarray, W: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """r with the constant of the burner's balance at its best value, wild records held down."""
    weight = np.ones(len(r))
    e = r
    for _ in range(PASSES):
        below = float(np.einsum("k,kj,kji,ki->", weight, scale, W, scale))
        if not below > 1e-9 * len(r):  # no balance left that has it
            return r
        e = r - scale * (float(np.einsum("k,kj,kji,ki->", weight, scale, W, r)) / below)
        size = np.einsum("kj,kji,ki->k", e, W, e)
        weight = 1.0 / (1.0 + size / max(float(np.median(size)), 1e-12))
    return e


def _misfit(r: np.ndarray, free: np.ndarray, R: np.ndarray, scale: np.ndarray) -> float:
    """Mean over the records of rᵀWr."""
    W = _weights(R, free)
    e = _constant(r, W, scale)
    return float(np.mean(np.einsum("kj,kji,ki->k", e, W, e)))


def _probe_error(
    r: np.ndarray, free: np.ndarray, g: np.ndarray, R: np.ndarray, scale: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What the other probes say that one is off by, (N,), and the standard deviation of that, its own included."""
    e = _constant(r, _weights(R, np.concatenate([free, g[:, :, None]], axis=2)), scale)
    W = _weights(R, free)
    worth = np.maximum(np.einsum("kj,kji,ki->k", g, W, g), 1e-300)
    return np.einsum("kj,kji,ki->k", g, W, e) / worth, 1.0 / np.sqrt(worth)
