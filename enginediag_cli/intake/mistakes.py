"""Which single simple mistake makes a recording and an engine agree: a unit, a swap, a gauge pressure, another engine.

A mistake is a change of the columns as they were recorded. Every one that a recording can hold is tried on the same
sample (comparison.py); what it would have to explain is the log-likelihood that the recording lacks as it is read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.engine.overview import heating_value_doubts
from enginediag_cli.intake.comparison import Columns, EngineReference, Misfit, engine_reference
from enginediag_cli.recordings.derived import (
    RULES,
    SEA_LEVEL_PA,
    SOUND_AT_SEA_LEVEL_M_S,
    isa_pressure,
    isa_temperature,
    mach_from_cas,
)
from enginediag_cli.units import UNITS, Unit, find_unit, known_unit, split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.recordings.recorder import Channel, Recorder

CONVERTED = -2.0
"""Log prior odds of a column that was converted by another factor than its unit's before it came, against one that is
in another unit than its name says: the first takes two slips."""
RARE = -2.5
"""The same of what is seldom met: units that engines are seldom recorded in, ambient pressure added twice."""
FIELD = {
    "temperature": ("K", "degC", "degF", "degR"),
    "pressure": ("Pa", "kPa", "psi", "bar", "mbar", "inHg", "MPa"),
    "length": ("m", "ft", "kft", "km"),
    "speed": ("m_s", "kt", "kmh"),
    "mass flow": ("kg_s", "kg_h", "lb_h", "lb_s"),
    "rotational speed": ("rpm", "rad_s", "Hz"),
    "power": ("W", "kW", "MW", "hp"),
    "torque": ("Nm", "lbf_ft", "kNm"),
    "force": ("N", "kN", "lbf"),
    "ratio": ("1", "pct"),
}
"""Units by dimension in which engines are recorded; any other of a dimension is rare."""
SPEED_OF_SOUND = 20.0468
"""√(γ R) of air in m/s per √K: γ = 1.4, R = 287.053 J/(kg K) (ISO 2533:1975)."""
FUEL_KG_M3 = 800.0
"""Density of jet fuel at 15 °C (ASTM D1655: 775 to 840), by which a volume flow is a mass flow."""
FLIGHT_LEVEL_M = 30.48
"""100 ft."""


@dataclass(frozen=True)
class Mistake:
    """What may be wrong with a file: `column` and what it really holds in `words`; `hint`: how to put it right. `kind`:
    unit, converted, gauge, percent, swapped, total temperature, airspeed, heating value or engine. change: the columns
    that were read → those that would have been right; `prior`: log prior odds against the commonest. values: engine
    parameters that differ; engine: the one that it is instead."""

    kind: str
    column: str
    words: str
    hint: str
    change: Callable[[Columns], Mapping[str, np.ndarray]]
    prior: float = 0.0
    values: Mapping[str, float] = field(default_factory=dict)
    engine: Engine | None = None


@dataclass(frozen=True)
class RecordingOrigin:
    """How the columns of a recording came to be: the recorder that mapped them, if one did, and the engine that they
    are to be compared with."""

    engine: Any
    recorder: Recorder | None = None
    instance: str = ""

    @property
    def channels(self) -> Mapping[str, Channel]:
        return {c.target: c for c in self.recorder.channels} if self.recorder is not None else {}

    def name(self, column: str) -> str:
        """The column as its file calls it."""
        channel = self.channels.get(column)
        if channel is None or self.recorder is None:
            return column
        return channel.source_column(
            self.recorder.engines.get(self.instance) or next(iter(self.recorder.engines.values()))
        )

    def scale(self, column: str) -> float | None:
        """What 100 % of a column is, where it is recorded so."""
        channel = self.channels.get(column)
        if channel is None or self.recorder is None:
            return None
        own = self.recorder.engines.get(self.instance) or next(iter(self.recorder.engines.values()))
        found = own["full_scale"].get(column)
        return channel.full_scale if found is None else float(found)

    def derived(self, columns: Columns, changed: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The columns with the changed ones, and with what the recorder derives from those made anew; heat soak, which
        needs the past, stays."""
        made, moved = {**columns, **changed}, set(changed)
        for settings in self.recorder.values["derived"] if self.recorder is not None else ():
            rule = RULES[settings["rule"]]
            if settings["name"] not in changed and settings["rule"] != "soak" and moved & set(rule.needs(settings)):
                made[settings["name"]] = rule.compute(made, settings)
                moved.add(settings["name"])
        return made

    def recorded(self, columns: Columns, sensors: Sequence[str]) -> list[str]:
        """Columns that were recorded, not made by a rule or given as a constant, and that the engine reads, perhaps by
        way of others."""
        needed = {*self.engine.inputs, *self.engine.optional_inputs, *sensors}
        if self.recorder is None:
            return [c for c in columns if c in needed]
        rules = [(s["name"], RULES[s["rule"]].needs(s)) for s in self.recorder.values["derived"]]
        for name, needs in reversed(rules):
            if name in needed:
                needed |= set(needs)
        return [c for c in self.channels if c in needed and c in columns]


def list_mistakes(origin: RecordingOrigin, columns: Columns, sensors: Sequence[str]) -> list[Mistake]:
    """All single mistakes that columns (K,) of a recording may hold; those that would change nothing are excluded."""
    recorded = origin.recorded(columns, sensors)
    found: list[Mistake] = []
    for column in recorded:
        found += _unit_mistakes(origin, column)
        found += _pressure_mistakes(origin, column, columns)
        found += _percent_mistakes(origin, column)
        found += _temperature_mistakes(origin, column, columns)
    found += _air_mistakes(origin, columns)
    found += _swap_mistakes(origin, recorded)
    for doubt in heating_value_doubts(origin.engine):
        name = f"{doubt.burner}.lower_heating_value_J_kg"
        words, hint = (
            f"the engine file has the wrong heating value: {doubt}",
            f"{doubt.lower:.3g} J/kg in the engine file",
        )
        found.append(Mistake("heating value", name, words, hint, lambda c: {}, values={name: doubt.lower}))
    return [m for m in found if _changes_columns(m, columns)]


def _changes_columns(mistake: Mistake, columns: Columns) -> bool:
    """Whether anything would be different by more than a hundredth, and nothing is beyond what numbers hold."""
    if mistake.values or mistake.engine is not None:
        return True
    for column, new in mistake.change(columns).items():
        old = columns.get(column, new)
        there = np.isfinite(old)
        if not np.isfinite(new[there]).all():
            return False
        if np.any(np.abs(new - old)[there] > 1e-3 * np.abs(old[there])):
            return True
    return False


def _unit_mistakes(origin: RecordingOrigin, column: str) -> Iterator[Mistake]:
    """A column in another unit than its name or its recorder says, or converted by another unit's factor."""
    target = known_unit(split_column(column)[1]) or (UNITS["1"] if origin.channels.get(column) else None)
    channel = origin.channels.get(column)
    if target is None or (channel is not None and origin.scale(column) is not None):
        return
    if column == "dT_isa_K":  # a difference, which has no zero to be wrong: `_deviation_mistakes`
        return
    declared = find_unit(channel.unit) if channel is not None else target
    per_volume = channel is not None and channel.density_kg_m3 is not None
    for unit in UNITS.values():
        rare = 0.0 if unit.name in FIELD.get(unit.dimension, ()) else RARE
        if unit.dimension == declared.dimension and unit.name != declared.name:
            # v = (a·raw + b)·…: the reading as it stands in the file, taken as another unit
            yield _unit_mistake(origin, column, _rescale(declared, unit), f"is in {unit.name}", unit.name, rare)
        elif unit.dimension == "volume flow" and target.dimension == "mass flow" and not per_volume:
            change = Unit(unit.name, "mass flow", "kg_s", unit.factor * FUEL_KG_M3)
            words = f"is in {unit.name} (of fuel of {FUEL_KG_M3:g} kg/m³)"
            yield _unit_mistake(origin, column, _rescale(declared, change), words, unit.name, RARE)
    if target.dimension == "length":
        level = Unit("flight level", "length", "m", FLIGHT_LEVEL_M)
        yield _unit_mistake(
            origin, column, _rescale(declared, level), "is the flight level (100 ft)", "ft, scale: 100", RARE
        )
    if channel is None:
        for taken, really in combinations(FIELD.get(target.dimension, ()), 2):
            for a, b in ((taken, really), (really, taken)):
                if a != declared.name:
                    words = f"was in {b} and was converted as if it were in {a}"
                    back = _rescale(UNITS[a], UNITS[b])
                    yield _unit_mistake(
                        origin, column, _convert_in_unit(target, back), words, b, CONVERTED, "converted"
                    )


def _unit_mistake(
    origin: RecordingOrigin,
    column: str,
    right: Callable[[np.ndarray], np.ndarray],
    words: str,
    unit: str,
    prior: float,
    kind: str = "unit",
) -> Mistake:
    mapped = f"`unit: {unit}` in the recorder"
    where = mapped if origin.channels.get(column) else f"convert it from {unit}, or state `unit: {unit}` in a recorder"
    return Mistake(kind, column, f"{origin.name(column)} {words}", where, lambda c: {column: right(c[column])}, prior)


def _rescale(taken: Unit, really: Unit) -> Callable[[np.ndarray], np.ndarray]:
    """SI values of what was taken to be in one unit, as they are when it is really in the other."""
    return lambda v: (v - taken.offset) / taken.factor * really.factor + really.offset


def _convert_in_unit(target: Unit, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    return lambda v: (change(v * target.factor + target.offset) - target.offset) / target.factor


def _pressure_mistakes(origin: RecordingOrigin, column: str, columns: Columns) -> Iterator[Mistake]:
    """A gauge pressure taken for an absolute one, and the other way round."""
    unit = known_unit(split_column(column)[1])
    if unit is None or unit.dimension != "pressure" or column == "ambient_pressure_Pa":
        return
    if not {"ambient_pressure_Pa", "altitude_m"} & set(columns):
        return
    name, hint = origin.name(column), "add the ambient pressure"
    yield Mistake(
        "gauge", column, f"{name} is a gauge pressure", hint, lambda c: {column: c[column] + _ambient_pressure(c)}
    )
    sea = f"{name} is a gauge pressure, one standard atmosphere too low"
    yield Mistake("gauge", column, sea, "add 101325 Pa", lambda c: {column: c[column] + SEA_LEVEL_PA})
    words = f"{name} is an absolute pressure to which the ambient one has been added"
    right = "take the ambient pressure off"
    yield Mistake("gauge", column, words, right, lambda c: {column: c[column] - _ambient_pressure(c)}, RARE)


def _ambient_pressure(columns: Columns) -> np.ndarray:
    found = columns["ambient_pressure_Pa"] if "ambient_pressure_Pa" in columns else isa_pressure(columns["altitude_m"])
    return np.asarray(found, float)


def _percent_mistakes(origin: RecordingOrigin, column: str) -> Iterator[Mistake]:
    """A speed in % where rpm were meant, or in rpm where % were."""
    unit, full = known_unit(split_column(column)[1]), origin.scale(column)
    if unit is None or unit.dimension != "rotational speed":
        return
    name = origin.name(column)
    if full is not None:
        right = "`unit: rpm` and no full_scale in the recorder"
        yield Mistake(
            "percent", column, f"{name} is in rpm, not in %", right, lambda c: {column: c[column] * 100 / full}
        )
        return
    shafts = {f"{s['speed_label']}_rpm": s["design_speed_rpm"] for s in origin.engine.declared["shafts"]}
    design = shafts.get(column)
    if design:
        right = f"`unit: pct` and `full_scale:` (about {design:g} rpm) in a recorder"
        words = f"{name} is in % of about {design:g} rpm"
        yield Mistake("percent", column, words, right, lambda c: {column: c[column] * design / 100})


def _temperature_mistakes(origin: RecordingOrigin, column: str, columns: Columns) -> Iterator[Mistake]:
    """A total temperature taken for the static one, T (1 + 0.2 M²) for T, and the other way round."""
    if "mach" not in columns or column not in _air_columns(origin):
        return
    name, kind, rule = origin.name(column), "total temperature", "rule static_temperature"
    if column == "ambient_temperature_K":
        words, hint = (
            "is the total air temperature, not the static one",
            f"map it to T2_K and derive the static one ({rule})",
        )
        yield Mistake(kind, column, f"{name} {words}", hint, lambda c: {column: c[column] / _total_over_static(c)})
    else:
        words, hint = (
            "is the static air temperature, not the total one",
            f"map it to ambient_temperature_K, without {rule}",
        )
        yield Mistake(kind, column, f"{name} {words}", hint, lambda c: {column: c[column] * _total_over_static(c)})


def _total_over_static(columns: Columns) -> np.ndarray:
    """T_total/T = 1 + 0.2 M², γ = 1.4."""
    return 1.0 + 0.2 * np.square(np.asarray(columns["mach"], float))


def _air_columns(origin: RecordingOrigin) -> set[str]:
    """Columns of the static temperature of the air, and of the total one that it is derived from."""
    found = {"ambient_temperature_K"}
    for settings in origin.recorder.values["derived"] if origin.recorder is not None else ():
        if settings["rule"] == "static_temperature":
            found |= {c for c in RULES["static_temperature"].needs(settings) if c != "mach"}
    return found


def _air_mistakes(origin: RecordingOrigin, columns: Columns) -> Iterator[Mistake]:
    """What is wrong with the Mach number, and with a recorded deviation from the standard atmosphere."""
    if "altitude_m" not in columns:
        return
    if "mach" in columns and "mach" in origin.engine.inputs:
        yield from _airspeed_mistakes(origin.name("mach"))
    made = origin.recorder is not None and "dT_isa_K" not in origin.channels
    if "dT_isa_K" in columns and not made and "dT_isa_K" in origin.engine.inputs:
        yield from _deviation_mistakes(origin.name("dT_isa_K"), "mach" in columns)


def _static_temperature(columns: Columns) -> np.ndarray:
    """Static air temperature (K,) in K."""
    return np.asarray(isa_temperature(columns["altitude_m"]) + columns.get("dT_isa_K", 0.0))


def _speed_of_sound(columns: Columns) -> np.ndarray:
    return SPEED_OF_SOUND * np.sqrt(np.maximum(_static_temperature(columns), 1.0))


def _airspeed_mistakes(name: str) -> Iterator[Mistake]:
    def mistake(words: str, rule: str, change: Callable[[Columns], np.ndarray], prior: float = 0.0) -> Mistake:
        return Mistake("airspeed", "mach", f"{name} {words}", rule, lambda c: {"mach": change(c)}, prior)

    tas, cas = "derive it (rule mach_from_tas)", "derive it (rule mach_from_cas)"
    for unit in FIELD["speed"]:
        per = UNITS[unit].factor
        yield mistake(f"is the true airspeed in {unit}", tas, _mach_from_true_airspeed(per))
        words = f"is the calibrated airspeed in {unit}"
        yield mistake(words, cas, _mach_from_calibrated_airspeed(per))
    words = "was made of the indicated airspeed as if it were the true one"
    yield mistake(words, cas, lambda c: mach_from_cas(c["mach"] * _speed_of_sound(c), c["altitude_m"]))
    words = "was made of the indicated airspeed and the speed of sound at sea level"
    yield mistake(words, cas, lambda c: mach_from_cas(c["mach"] * SOUND_AT_SEA_LEVEL_M_S, c["altitude_m"]), CONVERTED)
    yield mistake("is in %", "divide it by 100", lambda c: c["mach"] / 100.0)


def _mach_from_true_airspeed(per: float) -> Callable[[Columns], np.ndarray]:
    return lambda c: np.asarray(c["mach"] * per / _speed_of_sound(c))


def _mach_from_calibrated_airspeed(per: float) -> Callable[[Columns], np.ndarray]:
    return lambda c: mach_from_cas(c["mach"] * per, c["altitude_m"])


def _isa_deviation(
    change: Callable[[np.ndarray], np.ndarray], temperature: Callable[[Columns], np.ndarray]
) -> Callable[[Columns], np.ndarray]:
    return lambda c: change(temperature(c)) - isa_temperature(c["altitude_m"])


def _swap_columns(a: str, b: str, scale: float) -> Callable[[Columns], dict[str, np.ndarray]]:
    return lambda c: {a: c[b] * scale, b: c[a] / scale}


def _deviation_mistakes(name: str, with_mach: bool) -> Iterator[Mistake]:
    def mistake(
        kind: str, words: str, hint: str, change: Callable[[Columns], np.ndarray], prior: float = CONVERTED
    ) -> Mistake:
        return Mistake(kind, "dT_isa_K", f"{name} {words}", hint, lambda c: {"dT_isa_K": change(c)}, prior)

    rule = "derive it (rule isa_deviation)"
    if with_mach:
        words = "was made of the total air temperature, not of the static one"
        hint = "derive the static temperature first (rule static_temperature)"
        yield mistake(
            "total temperature",
            words,
            hint,
            lambda c: _static_temperature(c) / _total_over_static(c) - isa_temperature(c["altitude_m"]),
            0.0,
        )
    for unit in FIELD["temperature"]:
        change = _rescale(UNITS["K"], UNITS[unit])
        words = f"holds the static air temperature in {unit}"
        yield mistake("unit", words, rule, _isa_deviation(change, lambda c: c["dT_isa_K"]))
        words = f"was made of a temperature in {unit} taken as K"
        yield mistake("converted", words, "convert it first", _isa_deviation(change, _static_temperature))
    yield mistake("unit", "is in °F", "multiply it by 5/9", lambda c: c["dT_isa_K"] * 5 / 9)


def _swap_mistakes(origin: RecordingOrigin, recorded: Sequence[str]) -> Iterator[Mistake]:
    """Two columns of one dimension that are in each other's place."""
    for a, b in combinations(recorded, 2):
        units = [known_unit(split_column(c)[1]) for c in (a, b)]
        if units[0] is None or units[1] is None or units[0].dimension != units[1].dimension:
            continue
        scale = (origin.scale(a) or 1.0) / (origin.scale(b) or 1.0)
        words = f"{origin.name(a)} and {origin.name(b)} are swapped"
        hint = "exchange their names, or `from:` in the recorder"
        yield Mistake("swapped", a, words, hint, _swap_columns(a, b, scale))


CHANGED = 0.1
"""Change of ln f of a sensor that is one: half a unit of log-likelihood."""


@dataclass(frozen=True)
class MistakeTrial:
    """A mistake, the misfit with it put right, and by how much likelier (log odds) the recording then is than as read.
    rest: −ln p, with it put right, of the readings that it makes fit better or worse."""

    mistake: Mistake
    misfit: Misfit
    gain: float
    rest: float

    @staticmethod
    def from_misfits(mistake: Mistake, misfit: Misfit, as_read: Misfit) -> MistakeTrial:
        """With the misfits of a recording put right and as read."""
        before = dict(zip(as_read.sensors, np.log(as_read.factor).tolist(), strict=True))
        after = np.log(misfit.factor)
        # a sensor without readings as the file was read is changed in any case
        changed = np.abs(after - [before.get(s, -np.inf) for s in misfit.sensors]) > CHANGED
        own = np.where(changed, misfit.count * after, 0.0)
        gain = misfit.log_likelihood + mistake.prior - as_read.log_likelihood
        return MistakeTrial(mistake, misfit, gain, max(float(np.sum(own)), 0.0))


FINALISTS = 6
"""Mistakes that are linearised anew where they end: the others are behind by more than that would bring."""
SCREENED = 8
"""Records on which mistakes of inputs, each of which needs the model anew, are compared first."""
SHARED = 3
"""Sensors that two engines must have in common: fewer readings fit many engines."""
LEAST_FACTOR, LARGEST_FACTOR, FACTORS = 1.3, 4.0, 24
"""Factors of a column that are tried where no mistake is found: below, an instrument may be wrong by so much; beyond,
units are; in steps of 5 %, which errors of instruments bridge."""
BEYOND = 0.5
"""Share of the range of the engine's envelope, beyond its ends, where no engine is operated."""


def try_mistakes(
    yardstick: EngineReference, origin: RecordingOrigin, columns: Columns, as_read: Misfit
) -> list[MistakeTrial]:
    """All mistakes that may explain a sample of K records, the likeliest first. One with which fewer sensors have
    readings (a constant column in a sensor's place) explains nothing: it leaves the sensor out."""
    size = len(next(iter(columns.values())))
    few = np.unique(np.linspace(0, size - 1, min(SCREENED, size)).astype(int))
    sample = {c: v[few] for c, v in columns.items()}
    known = yardstick.predict(sample)
    before = yardstick.misfit(sample, 1, answer=known)
    read = set(before.sensors)
    inputs = [c for c in yardstick.input_columns if c in columns]
    tried: list[tuple[Mistake, Columns]] = []
    elsewhere: list[int] = []
    for mistake in list_mistakes(origin, sample, yardstick.sensors):
        changed = origin.derived(sample, mistake.change(sample))
        same = not mistake.values and all(np.array_equal(changed[c], sample[c]) for c in inputs)
        if same or _is_within_envelope(origin.engine, changed):
            elsewhere += [] if same or mistake.values else [len(tried)]
            tried.append((mistake, changed))
    answers = dict(zip(elsewhere, yardstick.predict_several([tried[k][1] for k in elsewhere]), strict=True))
    first: list[tuple[float, Mistake]] = []
    for k, (mistake, columns_then) in enumerate(tried):
        answer = None if mistake.values else answers.get(k, known)
        found = yardstick.misfit(columns_then, 1, mistake.values, answer)
        gain = found.log_likelihood + mistake.prior - before.log_likelihood
        if read <= set(found.sensors) and gain > 0.0:
            first.append((gain, mistake))
    first.sort(key=lambda one: -one[0])
    ended = []
    for _, mistake in first[:FINALISTS]:
        changed = origin.derived(columns, mistake.change(columns))
        misfit = yardstick.misfit(changed, 3, mistake.values)
        ended.append(MistakeTrial.from_misfits(mistake, misfit, as_read))
    return sorted(ended, key=lambda one: -one.gain)


def compare_other_engines(
    origin: RecordingOrigin, columns: Columns, as_read: Misfit
) -> Iterator[tuple[Mistake, Misfit]]:
    """The engines that come with the program and read these columns, each with the misfit of K records to it."""
    from enginediag_cli.errors import EngineDiagError
    from enginediag_cli.physics.engine_file import load_engine
    from enginediag_cli.shipped import shipped_folder

    for path in sorted(shipped_folder().glob("*.yaml")):
        try:
            engine = load_engine(path)
        except EngineDiagError:
            continue
        shared = [s for s in as_read.sensors if s in engine.sensors]
        if engine.name == origin.engine.name or len(shared) < SHARED or any(c not in columns for c in engine.inputs):
            continue
        yardstick = engine_reference(engine)
        kept = {
            c: v for c, v in columns.items() if c in shared or c not in as_read.sensors or c in yardstick.input_columns
        }
        words, hint = f"this is the engine {engine.name} ({path.name}), not {origin.engine.name}", f"use {path.name}"
        yield Mistake("engine", "", words, hint, lambda c: {}, engine=engine), yardstick.misfit(kept, 3)


def try_factors(
    yardstick: EngineReference, origin: RecordingOrigin, columns: Columns, as_read: Misfit
) -> MistakeTrial | None:
    """One column too large or too small by a factor that no unit explains and no instrument is wrong by; the likeliest
    of the columns and factors from LEAST_FACTOR to LARGEST_FACTOR, up and down."""
    size = len(next(iter(columns.values())))
    few = np.unique(np.linspace(0, size - 1, min(SCREENED, size)).astype(int))
    sample = {c: v[few] for c, v in columns.items()}
    steps = np.geomspace(LEAST_FACTOR, LARGEST_FACTOR, FACTORS)
    tried: list[tuple[Mistake, Columns]] = []
    before = dict(zip(as_read.sensors, as_read.before, strict=True))
    for column in origin.recorded(columns, yardstick.sensors):
        unit = known_unit(split_column(column)[1])
        if unit is None or unit.dimension == "temperature" or not np.nanmin(columns[column]) > 0.0:
            continue
        own = np.exp(before.get(column, 0.0))
        factors = [own] if abs(np.log(own)) >= np.log(LEAST_FACTOR) else []
        factors += [*steps, *(1.0 / steps)] if column in yardstick.engine.inputs else []
        for factor in factors:
            mistake = _factor_mistake(origin, column, float(factor))
            changed = origin.derived(sample, mistake.change(sample))
            if _is_within_envelope(origin.engine, changed):
                tried.append((mistake, changed))
    if not tried:
        return None
    answers = yardstick.predict_several([changed for _, changed in tried])
    likely = [yardstick.misfit(c, 1, answer=a).log_likelihood for (_, c), a in zip(tried, answers, strict=True)]
    mistake = tried[int(np.argmax(likely))][0]
    misfit = yardstick.misfit(origin.derived(columns, mistake.change(columns)), 3)
    return MistakeTrial.from_misfits(mistake, misfit, as_read)


def _factor_mistake(origin: RecordingOrigin, column: str, factor: float) -> Mistake:
    words = f"{origin.name(column)} reads {factor:.3g} times what it should"
    hint = "no unit explains it; another unit, full scale or density?"
    return Mistake("factor", column, words, hint, lambda c: {column: c[column] / factor}, RARE)


def _is_within_envelope(engine: Any, columns: Columns) -> bool:
    """Whether the medians of the inputs are where the engine may be operated."""
    for column, (low, high) in engine.envelope.items():
        room = BEYOND * (high - low)
        if column in columns and not low - room <= np.nanmedian(columns[column]) <= high + room:
            return False
    return True
