"""Flights to record next: those that an engine's envelope allows, and how soon each separates alternative hypotheses.

Flights. They are profiles, sweeps of power and of speed, and days hotter and colder. Each is a whole flight, as a crew
could be asked to fly it; what an engine cannot do of them is dropped by whoever judges them. An engine that stays where
it is runs through its load on days as cold and as hot as it is declared for.

Manoeuvres. They are steps, ramps and blips of power, for dynamic effects (with memory). These effects differ by how
they answer: a rate limit takes longer for a larger step, a lag does not, a delay is late by as much on a ramp.

Separation. A hypothesis h predicts the readings y_h of a record, in standard deviations of their noise, and how they
answer to whatever it may adapt: Y_h, the columns of everything that is identified, of its own coefficients and of a new
recording's offsets, each per standard deviation that is known of it. If h is true, n records of which G is the mean
Gram matrix, with d = y_h − y_g, leave the hypothesis g with a χ² more, after it has adapted, by

    λ_hg(n) = min_y n⟨|d − Y_g y|²⟩ + |y|² = n G_dd − n² G_dY (1 + n G_YY)⁻¹ G_Yd ,

which is λ_sep(I + nG) − λ_sep(I) of the score test's information I where g is what h would be taken for: what records
like those flown have taught is in the standard deviations of Y. What nobody has flown is as uncertain as its prior, and
so is how g would err there. The log odds of h over g are normal, of mean ½λ + ln(p_h/p_g) and variance λ. The right one
is identified where they are ln ODDS against every other; of several,

    P(n) = Σ_h p_h Π_{g≠h} Φ( (½λ_hg + ln(p_h/p_g) − ln ODDS) / √λ_hg ) ,

for two exactly, for more as if their log odds were independent: less than the truth where those rise and fall
together, as those of like hypotheses do (D. Slepian, "The one-sided barrier problem for Gaussian noise", Bell Syst.
Tech. J. 41 (1962) 463–501). What h itself does is taken as fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, product
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.evaluation import T_ISA, standard_atmosphere
from enginediag_cli.simulation.flights import complete_inputs

RECORDS = 160
"""Records of a planned flight: an hour and a half of one every half minute, what an airline's flight brings in."""
INTERVAL_S = 30.0
"""Between records of a flight: slow enough for heat soak and rotors to follow."""


@dataclass(frozen=True)
class Corner:
    """Of the course, straight lines between: `share` of the flight's duration from 0 to 1; power as fraction of the
    rating; deviation from the standard day in K. An engine that stays where it is is at altitude 0."""

    share: float
    power: float
    altitude_m: float = 0.0
    mach: float = 0.0
    dT_isa_K: float = 0.0


@dataclass(frozen=True)
class PlannedFlight:
    """`kind` of flight, `words` that describe it, its corners, further inputs of the engine fixed at
    `constants`; records every `interval_s`."""

    kind: str
    words: str
    corners: Sequence[Corner]
    constants: Mapping[str, float] = field(default_factory=dict)
    records: int = RECORDS
    interval_s: float = INTERVAL_S

    @property
    def duration_s(self) -> float:
        return self.interval_s * (self.records - 1)

    def time(self, records: int) -> np.ndarray:
        """Times (records,) evenly over the flight, in s."""
        return np.linspace(0.0, self.duration_s, records)

    def inputs(self, engine: Engine, records: int) -> dict[str, np.ndarray]:
        """The engine's inputs (records,), evenly over the flight."""
        time = self.time(records)
        at = self.duration_s * np.array([c.share for c in self.corners])
        course = {
            name: np.interp(time, at, [getattr(c, name) for c in self.corners])
            for name in ("altitude_m", "mach", "dT_isa_K")
        }
        power = np.interp(time, at, [c.power for c in self.corners])
        labels = {"time_s": time, "flight": np.ones(records), "phase": np.zeros(records)}
        flown = complete_inputs({**course, **labels, "power_fraction": power}, engine, self.constants)
        return {c: np.asarray(flown.columns[c], float) for c in engine.inputs}

    def flight_file(self, engine: Engine) -> dict[str, Any]:
        """Values of a flight file that says the same."""
        last = None
        points = []
        for c in self.corners:
            point: dict[str, Any] = {"time_s": round(c.share * self.duration_s, 3), "power": round(c.power, 4)}
            if "altitude_m" in engine.inputs and c.altitude_m != getattr(last, "altitude_m", 0.0):
                point["altitude_m"] = round(c.altitude_m, 1)
            if "mach" in engine.inputs and c.mach != getattr(last, "mach", 0.0):
                point["mach"] = round(c.mach, 4)
            if c.dT_isa_K != getattr(last, "dT_isa_K", 0.0):
                point["dT_isa_K"] = round(c.dT_isa_K, 2)
            points.append(point)
            last = c
        return {
            "kind": "flight",
            "description": f"planned: {self.words}",
            "source": "planned between alternative hypotheses",
            "flights": 1,
            "mission": {"type": "manoeuvres", "record_interval_s": self.interval_s, "set_points": points},
            **({"constants": {c: float(f"{v:.6g}") for c, v in self.constants.items()}} if self.constants else {}),
        }


AIRLINER, CLIMB, DESCENT, SWEEP, SPEEDS, LEVELS, WEATHER = (
    "airliner flight",
    "climb",
    "descent",
    "power sweep",
    "speed sweep",
    "power sweeps at several levels",
    "a week of weather",
)
KINDS = (AIRLINER, CLIMB, DESCENT, SWEEP, SPEEDS, LEVELS, WEATHER)
"""What a planned flight may be."""

CEILING, MIDDLE, LOW = 0.95, 0.6, 0.3
"""Levels at which power and speed are swept, as shares of the envelope's ceiling."""
HIGHER, USUAL, LOWER = 0.93, 0.75, 0.45
"""Cruise levels of airliner flights, in the same way."""
OF_ENVELOPE = 0.8
"""Share of the envelope that the hottest and the coldest day reach: such days can be waited for. Judgement."""
USUAL_EAS, SLOW_EAS, FAST_EAS = 150.0, 85.0, 180.0
"""Equivalent airspeeds, m/s, of a climb, and the slowest and fastest that a crew would hold."""
OF_FASTEST = 0.95
"""Of the envelope's highest Mach number."""
IDLE, FLIGHT_IDLE, RATING = 0.0, 0.25, 1.0
"""Power fractions between which power is swept on the ground, and in the air, where engines seldom idle long."""
INSIDE = 0.1
"""Of the width of an envelope, kept from its ends by what is held there."""
LOAD_INTERVAL_S, WEATHER_INTERVAL_S = 60.0, 3600.0
"""Between records of a machine that stays where it is: minutes through a change of load, hours through weather."""


def flights(engine: Engine, flown: Mapping[str, np.ndarray]) -> list[PlannedFlight]:
    """Flights to choose from; `flown`: the engine's inputs over all records so far, column → (N,), from which inputs
    that no flight varies are fixed at their usual value. None for an engine without an envelope or a power range."""
    columns = ("altitude_m", "mach") if "altitude_m" in engine.inputs else ("ambient_temperature_K",)
    if engine.power_range is None or any(c in engine.inputs and c not in engine.envelope for c in columns):
        return []
    usual = usual_inputs(engine, flown)
    if usual is None:
        return []
    found = _airborne_flights(engine, usual) if "altitude_m" in engine.inputs else _ground_flights(engine, usual)
    return list(found)


def usual_inputs(engine: Engine, flown: Mapping[str, np.ndarray]) -> dict[str, float] | None:
    """Inputs that are fixed at the middle of what was flown, or of the envelope; None where neither is known."""
    moved = {"altitude_m", "mach", "dT_isa_K", "ambient_temperature_K", engine.power_setting}
    found: dict[str, float] = {}
    for c in (*engine.inputs, *engine.optional_inputs):
        values = np.asarray(flown.get(c, ()), float)
        if c in moved or (c in engine.optional_inputs and np.all(values == engine.optional_inputs[c])):
            continue
        if np.isfinite(values).any():
            found[c] = float(np.nanmedian(values))
        elif c in engine.envelope:
            found[c] = float(np.mean(engine.envelope[c]))
        elif c in engine.inputs and c != "ambient_pressure_Pa":
            return None
    return found


def _airborne_flights(engine: Engine, usual: Mapping[str, float]) -> Iterator[PlannedFlight]:
    ceiling = engine.envelope["altitude_m"][1]
    days = _days(engine)
    for share, dT in chain(((USUAL, d) for d in days), ((s, 0.0) for s in (HIGHER, LOWER))):
        top, low = share * ceiling, 0.15 * share * ceiling
        corners = [
            _corner(engine, 0.0, 0.95, low, dT),
            _corner(engine, 0.3, 0.85, top, dT),
            _corner(engine, 0.301, 0.75, top, dT),
            _corner(engine, 0.75, 0.6, top, dT),
            _corner(engine, 0.751, 0.35, top, dT),
            _corner(engine, 1.0, 0.3, low, dT),
        ]
        yield PlannedFlight(AIRLINER, f"an airliner flight to {_level(top)}{_day(dT)}", corners, usual)
    top = CEILING * ceiling
    for dT in days:
        corners = [_corner(engine, 0.0, 1.0, 0.0, dT), _corner(engine, 1.0, 0.9, top, dT)]
        yield PlannedFlight(CLIMB, f"a climb from the ground to {_level(top)}{_day(dT)}", corners, usual)
        corners = [_corner(engine, 0.0, 0.4, top, dT), _corner(engine, 1.0, 0.25, 0.05 * top, dT)]
        yield PlannedFlight(DESCENT, f"a descent from {_level(top)}{_day(dT)}", corners, usual)
    levels = (0.0, LOW * ceiling, MIDDLE * ceiling, top)
    for level, dT in chain(((h, 0.0) for h in levels), ((h, d) for h in (0.0, top) for d in days if d)):
        yield _sweep(engine, level, dT, usual)
    for level in levels[1:]:
        for power in (0.6, 0.9):
            slow, fast = (_mach(engine, level, eas) for eas in (SLOW_EAS, FAST_EAS))
            corners = [Corner(0.0, power, level, slow), Corner(1.0, power, level, fast)]
            words = f"speed from Mach {slow:.2g} to {fast:.2g} at {_level(level)}, power held at {100 * power:.0f} %"
            yield PlannedFlight(SPEEDS, words, corners, usual)
    for dT in days:
        yield _several_levels(engine, levels, dT, usual)
    for c, value in _other_values(engine, usual):
        words = f"power swept from idle to rating at {_level(levels[2])} with {c} {value:.4g}"
        yield PlannedFlight(SWEEP, words, _sweep(engine, levels[2], 0.0, usual).corners, {**usual, c: value})


def _sweep(engine: Engine, level: float, dT: float, usual: Mapping[str, float]) -> PlannedFlight:
    low = FLIGHT_IDLE if level > 0.0 else IDLE
    corners = [_corner(engine, share, power, level, dT) for share, power in ((0.0, low), (1.0, RATING))]
    where = f"at {_level(level)}, Mach {corners[0].mach:.2g}" if level > 0.0 else "on the ground"
    return PlannedFlight(SWEEP, f"power swept from idle to rating {where}{_day(dT)}", corners, usual)


def _several_levels(engine: Engine, levels: Sequence[float], dT: float, usual: Mapping[str, float]) -> PlannedFlight:
    """A sweep at each of the levels, up at one and down at the next."""
    corners, low, part = [], FLIGHT_IDLE, 1.0 / len(levels)
    for k, level in enumerate(levels):
        powers = (low, RATING) if k % 2 == 0 else (RATING, low)
        corners.append(_corner(engine, k * part + (0.001 if k else 0.0), powers[0], level, dT))
        corners.append(_corner(engine, (k + 1) * part, powers[1], level, dT))
    told = ", ".join(_level(h) for h in levels[1:])
    return PlannedFlight(LEVELS, f"power swept on the ground and at {told}{_day(dT)}", corners, usual)


def _ground_flights(engine: Engine, usual: Mapping[str, float]) -> Iterator[PlannedFlight]:
    low, high = engine.envelope["ambient_temperature_K"]
    room = INSIDE * (high - low)
    cold, hot = low + room, high - room
    for T in (cold, 0.5 * (cold + hot), hot):
        corners = _course([(0.0, IDLE, T), (1.0, RATING, T)])
        words = f"load swept from idle to rating at an ambient temperature of {T:.0f} K"
        yield PlannedFlight(SWEEP, words, corners, usual, interval_s=LOAD_INTERVAL_S)
    for load in (RATING, 0.6):
        corners = _course([(0.0, load, cold), (1.0, load, hot)])
        words = f"a week from {cold:.0f} to {hot:.0f} K of ambient temperature at {100 * load:.0f} % load"
        yield PlannedFlight(WEATHER, words, corners, usual, interval_s=WEATHER_INTERVAL_S)
    for c, value in _other_values(engine, usual):
        T = 0.5 * (cold + hot)
        words = f"load swept from idle to rating with {c} {value:.4g}"
        corners = _course([(0.0, IDLE, T), (1.0, RATING, T)])
        yield PlannedFlight(SWEEP, words, corners, {**usual, c: value}, interval_s=LOAD_INTERVAL_S)


def _course(points: Sequence[tuple[float, float, float]]) -> list[Corner]:
    """Corners from shares of the time, powers and ambient temperatures."""
    return [Corner(share, power, dT_isa_K=T - T_ISA) for share, power, T in points]


def _other_values(engine: Engine, usual: Mapping[str, float]) -> Iterator[tuple[str, float]]:
    """Near both ends of its envelope, every further input that a crew sets."""
    for c in usual:
        if c in engine.inputs and c in engine.envelope and c != "ambient_pressure_Pa":
            low, high = engine.envelope[c]
            for share in (INSIDE, 1.0 - INSIDE):
                yield c, low + share * (high - low)


def _corner(engine: Engine, share: float, power: float, altitude: float, dT: float) -> Corner:
    return Corner(share, power, altitude, _mach(engine, altitude, USUAL_EAS) if altitude > 0.0 else _taxi(engine), dT)


def _mach(engine: Engine, altitude: float, eas: float) -> float:
    """½ γ p M² = ½ ρ₀ EAS², within the envelope."""
    pressure = float(np.asarray(standard_atmosphere(altitude)[1]))
    low, high = engine.envelope["mach"]
    return float(np.clip(eas / np.sqrt(1.4 * pressure / 1.225), low, OF_FASTEST * high))


def _taxi(engine: Engine) -> float:
    """A run-up at standstill."""
    return max(engine.envelope["mach"][0], 0.0)


def _days(engine: Engine) -> tuple[float, ...]:
    """Deviations from the standard day: none, hot, cold."""
    if "dT_isa_K" not in engine.inputs or "dT_isa_K" not in engine.envelope:
        return (0.0,)
    low, high = engine.envelope["dT_isa_K"]
    return 0.0, OF_ENVELOPE * high, OF_ENVELOPE * low


def _level(altitude: float) -> str:
    return f"{100.0 * round(altitude / 100.0):,.0f} m"


def _day(dT: float) -> str:
    if dT == 0.0:
        return ""
    return f" on a {'hot' if dT > 0.0 else 'cold'} day ({dT:+.0f} K from standard)"


STEPS = {"altitude_m": 5, "mach": 5, "dT_isa_K": 1}
"""Values over the envelope: fine where the sensitivities change most, one where they hardly do. The product is what the
advice costs."""
OTHER_STEPS = 4
"""Values of any other input, and of a power setting without a range."""
POWER = (0.3, 0.5, 0.75, 1.0)
"""Fractions of the power range that a crew would hold for a while."""
SLOWEST, FASTEST = 70.0, 190.0
"""Equivalent airspeeds, m/s, between which an aircraft flies; on the ground it may stand."""
GROUND_M = 300.0
"""Below this altitude the engine may run on the ground, at any speed."""


def conditions_grid(engine: Any) -> dict[str, np.ndarray]:
    """Inputs of the engine, column -> (C,), over its envelope; empty when the engine file gives no envelope."""
    envelope = dict(engine.envelope)
    power = engine.power_setting
    columns = [c for c in engine.inputs if c != power]
    if any(c not in envelope for c in columns) or (engine.power_range is None and power not in envelope):
        return {}
    axes = []
    for column in columns:
        low, high = envelope[column]
        steps = STEPS.get(column, OTHER_STEPS)
        axes.append([0.5 * (low + high)] if steps == 1 else np.linspace(low, high, steps).tolist())
    if engine.power_range is not None:
        axes.append(list(POWER))
    else:
        low, high = envelope[power]
        axes.append(np.linspace(low, high, OTHER_STEPS).tolist())
    points = np.array(list(product(*axes)))
    inputs = {column: points[:, j] for j, column in enumerate(columns)}
    inputs[power] = points[:, -1]
    if engine.power_range is not None:
        inputs[power] = np.asarray(engine.power_from_fraction(points[:, -1], inputs))
        low, high = envelope.get(power, (-np.inf, np.inf))
        inputs[power] = np.clip(inputs[power], low, high)
    flyable = _flyable(inputs)
    return {column: inputs[column][flyable] for column in engine.inputs}


def _flyable(inputs: dict[str, np.ndarray]) -> np.ndarray:
    """Points (C,) at which the dynamic pressure is that of flight: ½ γ p M² = ½ ρ₀ EAS²."""
    size = len(next(iter(inputs.values())))
    if "altitude_m" not in inputs or "mach" not in inputs:
        return np.ones(size, bool)
    pressure = np.asarray(standard_atmosphere(inputs["altitude_m"])[1])
    speed = inputs["mach"] * np.sqrt(1.4 * pressure / 1.225)
    return (speed <= FASTEST) & ((speed >= SLOWEST) | (inputs["altitude_m"] < GROUND_M))


MANOEUVRE = "manoeuvre"
DURATION_S = 300
"""Of a manoeuvre, recorded once a second."""
BEGIN_S, STEP_S, BLIP_S = 30.0, 1.0, 10.0
"""When power begins to change, how long that takes at once, and how long a blip lasts."""

MANOEUVRES: Mapping[str, tuple[tuple[float, float], ...]] = {
    "a step of power from 10 to 90 % of its range": ((0.0, 0.1), (STEP_S, 0.9)),
    "a step of power from 90 to 10 % of its range": ((0.0, 0.9), (STEP_S, 0.1)),
    "a step of power from 45 to 55 % of its range": ((0.0, 0.45), (STEP_S, 0.55)),
    "a ramp of power from 10 to 90 % in a minute": ((0.0, 0.1), (60.0, 0.9)),
    "a ramp of power from 10 to 90 % in three minutes": ((0.0, 0.1), (180.0, 0.9)),
    "power raised from 10 to 90 % for ten seconds": (
        (0.0, 0.1),
        (STEP_S, 0.9),
        (BLIP_S, 0.9),
        (BLIP_S + STEP_S, 0.1),
    ),
}
"""What may be flown, in words, and power against seconds since BEGIN_S, straight between."""


def manoeuvres(engine: Engine, flown: Mapping[str, np.ndarray]) -> list[PlannedFlight]:
    """Manoeuvres at the middle of what was flown (inputs, column → (N,)); none for an engine of which it is not known
    how much power it may be asked for."""
    usual = usual_inputs(engine, flown)
    if engine.power_range is None or usual is None:
        return []
    altitude, mach, dT = (_middle(flown, c) for c in ("altitude_m", "mach", "dT_isa_K"))
    if "ambient_temperature_K" in engine.inputs:
        dT = _middle(flown, "ambient_temperature_K", T_ISA) - float(np.asarray(standard_atmosphere(altitude)[0]))
    last = DURATION_S - 1.0
    return [
        PlannedFlight(
            MANOEUVRE,
            words,
            [
                Corner(second / last, power, altitude, mach, dT)
                for second, power in (
                    (0.0, course[0][1]),
                    *((BEGIN_S + s, p) for s, p in course),
                    (last, course[-1][1]),
                )
            ],
            usual,
            DURATION_S,
            1.0,
        )
        for words, course in MANOEUVRES.items()
    ]


def _middle(flown: Mapping[str, np.ndarray], column: str, default: float = 0.0) -> float:
    values = np.asarray(flown.get(column, ()), float)
    return float(np.nanmedian(values)) if np.isfinite(values).any() else default


ODDS = 19.0
"""To one, at which the right explanation is identified: a probability of 95 %."""
SURE = 0.9
"""Probability of standing out at which records are enough. Judgement: the tenth needs one flight more."""
MOST_RECORDS = 10_000
"""More than a recording to come would have: reported as “never”. (A flight of three hours at one a second.)"""


TRIED = 16
"""Numbers of records, each twice the one before or so, that are tried for the fewest."""


@dataclass(frozen=True)
class Adaptation:
    """What a hypothesis may adapt to records of one kind: its columns Y (k, m, q), eigenvalues (q,) and vectors (q,
    q) of G_YY."""

    columns: np.ndarray
    values: np.ndarray
    vectors: np.ndarray

    @classmethod
    def from_columns(cls, columns: np.ndarray) -> Adaptation:
        """Of typical records: Y (k, m, q), per standard deviation."""
        rows = columns.reshape(columns.shape[0] * columns.shape[1], columns.shape[2])
        values, vectors = np.linalg.eigh(rows.T @ rows / len(columns))
        return cls(columns, np.maximum(values, 0.0), vectors)

    def separation(self, difference: np.ndarray) -> Separation:
        """From what foresees another reading by d (k, m)."""
        k = len(difference)
        pull = np.einsum("kmq,km->q", self.columns, difference) / k
        return Separation(float(np.sum(difference**2)) / k, self.values, (self.vectors.T @ pull) ** 2)


@dataclass(frozen=True)
class Separation:
    """λ(n) of a hypothesis if another is true, over records of one kind. `size`: G_dd; `values` (q,): eigenvalues of
    G_YY; `pulls` (q,): squares of G_Yd along its vectors."""

    size: float
    values: np.ndarray
    pulls: np.ndarray

    @classmethod
    def from_gram(cls, gram: np.ndarray) -> Separation:
        """From G (1 + q, 1 + q) of [d Y]."""
        values, vectors = np.linalg.eigh(gram[1:, 1:])
        return cls(float(gram[0, 0]), np.maximum(values, 0.0), (vectors.T @ gram[1:, 0]) ** 2)

    def __call__(self, n: float) -> float:
        """λ of n records."""
        return max(float(n * self.size - n * n * np.sum(self.pulls / (1.0 + n * self.values))), 0.0)


def fewest(enough: Callable[[float], bool], most: int = MOST_RECORDS) -> float:
    """The least number of records from which on every number is enough; inf where `most` are not. Between TRIED numbers
    it is bisected: what a few records leave as it is, some more may yet upset."""
    tried = np.unique(np.geomspace(1, most, TRIED).round().astype(int))
    low = max((int(n) for n in tried if not enough(float(n))), default=0)
    if low == most:
        return float("inf")
    high = int(tried[np.searchsorted(tried, low, "right")])
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return float(high)


@dataclass(frozen=True)
class Outlook:
    """What records of one kind promise: `probabilities` (K,) of the hypotheses now; `separations`[h][g] of the
    hypothesis g if h is true, None where g need not be separated from h: g = h, or a g that holds all of h."""

    probabilities: np.ndarray
    separations: Sequence[Sequence[Separation | None]]

    def lambdas(self, n: float) -> np.ndarray:
        """λ_hg (K, K) of n records, infinite where there is nothing to separate."""
        return np.array([[np.inf if s is None else s(n) for s in row] for row in self.separations])

    def chance_each(self, n: float) -> np.ndarray:
        """(K,): the probability that each hypothesis is identified after n records, if it is true."""
        from scipy.special import ndtr

        p, lam = self.probabilities, self.lambdas(n)
        lead = np.log(p[:, None] / p) - np.log(ODDS)
        with np.errstate(divide="ignore", invalid="ignore"):
            z = np.where(lam > 0.0, 0.5 * np.sqrt(lam) + lead / np.sqrt(lam), np.where(lead >= 0.0, np.inf, -np.inf))
        return np.asarray(np.prod(ndtr(z), axis=1))

    def chance(self, n: float) -> float:
        """P(n), over the hypotheses that differ from another."""
        asked = [any(s is not None for s in row) for row in self.separations]
        weight = np.where(asked, self.probabilities, 0.0)
        return float(weight @ self.chance_each(n) / max(weight.sum(), 1e-300))

    @cached_property
    def records(self) -> float:
        """The fewest after which the right one is identified with the probability SURE; inf beyond MOST_RECORDS."""
        return fewest(lambda n: self.chance(n) >= SURE)


SAME, SWITCH, SENSOR = "same", "switch", "sensor"
"""Of recordings that are no planned flight: more like those there are, the same with an effect switched off and on by
turns, the same with a further sensor."""
BEYOND = 0.2
"""Share of a flight outside of what was flown from which it is marked as going beyond that."""


@dataclass(frozen=True)
class Suggestion:
    """One possible recording, judged.

    Attributes
    ----------
    kind : str
        Kind of recording.
    subject : str
        The flight in words, the effect that is switched, or the column of the sensor.
    chance : float
        Probability that the right hypothesis is identified after RECORDS records.
    records : float
        Fewest records that are enough; inf where no number is.
    flight : PlannedFlight or None
        The flight.
    is_flown : bool
        Whether it keeps to conditions that were flown.
    """

    kind: str
    subject: str
    chance: float
    records: float
    flight: PlannedFlight | None = None
    is_flown: bool = True

    @classmethod
    def from_outlook(
        cls, outlook: Outlook, kind: str, what: str = "", flight: PlannedFlight | None = None, known: bool = True
    ) -> Suggestion:
        return cls(kind, what, outlook.chance(RECORDS), outlook.records, flight, known)


def best_first(found: Iterable[Suggestion]) -> list[Suggestion]:
    """Soonest enough first; of those that RECORDS records are not enough of, likeliest after so many."""
    return sorted(found, key=lambda s: (min(s.records, RECORDS + 1.0), -s.chance, s.records))


def best_of_each_kind(found: Iterable[Suggestion]) -> list[Suggestion]:
    """The first of every kind of suggestions in their order."""
    best: dict[str, Suggestion] = {}
    for s in found:
        best.setdefault(s.kind, s)
    return list(best.values())


def is_inside_flown(flown: Mapping[str, np.ndarray], inputs: Mapping[str, np.ndarray]) -> bool:
    """Whether most of a flight lies within the ranges of what was flown, columns → (N,) each."""
    outside = np.zeros(len(next(iter(inputs.values()))), bool)
    for c, values in inputs.items():
        was = np.asarray(flown.get(c, values), float)
        outside |= (values < np.nanmin(was)) | (values > np.nanmax(was))
    return bool(outside.mean() <= BEYOND)
