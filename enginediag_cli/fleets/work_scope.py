"""Work scope: what restoring a module would gain in temperature and fuel at equal power.

An engine at given power: the power setting follows the state of health. With F(p, θ) thrust or power, p the power
setting and y another output, p(θ) is where F(p, θ) = F*, and

    dy/dθ = ∂y/∂θ − (∂y/∂p) (∂F/∂p)⁻¹ ∂F/∂θ

Gain of restoring a module. With δ the change of the parameters, δ_m that of the module m, and y temperature or fuel at
given power,

    gain_m = y(θ0 + δ) − y(θ0 + δ with δ_m = 0),     variance gᵀ C g,   g = ∂gain_m/∂δ,

positive where restoring lowers y; C the posterior covariance of δ. Both terms are solutions of the engine, and g their
exact derivatives.

Power, torque or thrust available at a limit. A limit of a temperature, a speed, a torque holds y(p, θ) = y*; the
limit that binds is the one that the least power setting p reaches, and there F is available, with

    dF/dθ = ∂F/∂θ − (∂F/∂p) (∂y/∂p)⁻¹ ∂y/∂θ
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine.components.combustion import Burner
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.start import correction, total_ratios
from enginediag_cli.engine.strategy import Prediction
from enginediag_cli.history.posterior import ChangeEvent
from enginediag_cli.isolation.diagnosis import infer_components
from enginediag_cli.isolation.posterior import SetInference
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.isolation.results import AmbiguityGroup, temper
from enginediag_cli.isolation.windows import IsolatedWindow
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.monitor import Monitor

THRUST, POWER = "Fn_N", "power_W"
"""What is held, in this order of preference from the last: the power of all loads, else net thrust."""
FUELS = ("Wf_total_kg_s", "Wf_kg_s")
"""Columns of fuel flow, all burners together first."""
DESIGN, RATING, RECORDED = "design point", "rating at the design condition", "mean recorded conditions"


@dataclass(frozen=True)
class PowerReference:
    """One operating point of a healthy engine, at which gains are compared.

    Attributes
    ----------
    inputs : mapping of str to float
        Inputs, the power setting among them.
    fixed_column : str
        Model column that is the same before and after: thrust or power.
    temperature : str
        Hottest recorded turbine temperature; without one (`recorded` false) the model's behind the last turbine.
    fuel : str
        Column of the fuel flow.
    words : str
        Which operating point it is.
    recorded : bool
        Whether the temperature is recorded.
    """

    inputs: Mapping[str, float]
    fixed_column: str
    temperature: str
    fuel: str
    words: str
    recorded: bool = True

    @property
    def columns(self) -> tuple[str, str, str]:
        """Of what is held, of the temperature and of the fuel."""
        return self.fixed_column, self.temperature, self.fuel


def plain_engine(model: Any) -> Engine | None:
    """The engine inside a model that wraps it; None where there is none."""
    while not isinstance(model, Engine):
        if not hasattr(model, "model"):
            return None
        model = model.model
    return model


def choose_reference(engine: Engine, base: Mapping[str, float], recorded: Mapping[str, float]) -> PowerReference | None:
    """The design point; where that is not known or cannot be computed, the rating in the design point's flight
    condition, or else the mean of what was recorded, column -> value. base: parameters of the healthy engine. None
    where none of these is known or the engine gives neither thrust nor power."""
    columns = engine.model_columns
    held = next((c for c in (POWER, THRUST) if c in columns), None)
    fuel = next((c for c in FUELS if c in columns), None)
    if held is None or fuel is None:
        return None
    values = {n: v for n, v in base.items() if n in engine.parameters}
    behind, hot = f"T{engine.network.last_turbine_exit}_K", hot_sensors(engine)
    for words, inputs in _candidates(engine, recorded):
        answer = engine.predict(inputs, values, sensors=(held, fuel, *hot))
        if answer.ok[0] and answer.y[0, 0] > 0:
            temperature = hot[int(np.argmax(answer.y[0, 2:]))] if hot else behind
            return PowerReference(inputs, held, temperature, fuel, words, recorded=bool(hot))
    return None


def _candidates(engine: Engine, recorded: Mapping[str, float]) -> Iterator[tuple[str, dict[str, float]]]:
    """Operating points that may serve, the best first: words, and all inputs of the engine."""
    condition, network = design_condition(engine), engine.network
    if condition is not None:
        known = {**engine.optional_inputs, **condition}
        setting = np.asarray(network.design_setting * correction(network.power_setting, *total_ratios(known)), float)
        if network.demand is not None:
            setting = network.demand.set_point(setting)
        yield DESIGN, {**condition, engine.power_setting: float(np.ravel(setting)[0])}
        if engine.power_range is not None:
            rating = engine.power_from_fraction(1.0, known)
            yield RATING, {**condition, engine.power_setting: float(np.ravel(rating)[0])}
    if all(c in recorded for c in engine.inputs):
        yield RECORDED, {c: recorded[c] for c in engine.inputs}


def design_condition(engine: Engine, stated: Mapping[str, float] | None = None) -> dict[str, float] | None:
    """Inputs but the power setting at the design point, or as `stated`; None where one of them has no value there."""
    network, found = engine.network, {}
    for column in engine.inputs:
        if column == engine.power_setting:
            continue
        if stated is not None and column in stated:
            found[column] = stated[column]
            continue
        if column in network.speed_columns:
            found[column] = float(network.shafts[network.speed_columns[column]]["design_speed_rpm"])
        elif column in network.design:
            found[column] = float(network.design[column])
        else:
            return None
    return found


def hot_sensors(engine: Engine) -> tuple[str, ...]:
    """Sensors that read temperatures behind the burner."""
    hot: set[str] = set()
    behind = False
    for c in engine.network.components:
        behind = behind or isinstance(c, Burner)
        if behind:
            hot |= {f"T{c.values[end]}_K" for end in ("to", "rotor_inlet_station") if c.values.get(end)}
    return tuple(c for c, s in engine.sensors.items() if not s.denominator and s.reads.keys() <= hot)


STEPS = 15
"""Newton steps for the power setting at most."""
SETTLED = 1e-9
"""Relative error of what is held at which they end."""
LONGEST = 0.1
"""Longest step, as a share of the power setting: thrust is not straight in a spool speed."""


@dataclass(frozen=True)
class EqualPowerState:
    """Temperature and fuel y (N, 2) of N states of an engine at equal power, their derivatives (N, 2, k) by
    parameters, and the power setting (N,)."""

    y: np.ndarray
    slopes: np.ndarray
    setting: np.ndarray


class PowerNotHeldError(ValueError):
    """The power of the healthy engine is not reached, with the reason."""


def design_unknowns(engine: Engine) -> np.ndarray:
    """The engine's unknowns (nx, 1) at the design point: a solution that begins there has the same digits whatever the
    engine has computed before."""
    return np.array([[unknown.start] for unknown in engine.unknowns])


def _changed_parameters(
    engine: Engine, base: Mapping[str, float], names: Sequence[str], changes: np.ndarray
) -> dict[str, Any]:
    """Parameters of the states base + changes (N, k) of the parameters `names`."""
    values = {n: v for n, v in base.items() if n in engine.parameters}
    nominal = [values.get(n, engine.parameters[n].nominal) for n in names]
    return {**values, **{n: nominal[i] + changes[:, i] for i, n in enumerate(names)}}


def solve_equal_power(
    engine: Engine,
    reference: PowerReference,
    base: Mapping[str, float],
    names: Sequence[str],
    changes: np.ndarray,
) -> EqualPowerState:
    """The states base + changes (N, k) of the parameters `names` at the power that `base` has at the reference.

    Raises PowerNotHeldError.
    """
    values = {n: v for n, v in base.items() if n in engine.parameters}
    start = design_unknowns(engine)
    healthy = engine.predict(reference.inputs, values, sensors=(reference.fixed_column,), start=start)
    if not healthy.ok[0]:
        raise PowerNotHeldError(healthy.reason(0) or "the engine cannot be computed there")
    wanted = float(healthy.y[0, 0])
    if not wanted:
        raise PowerNotHeldError(f"{reference.fixed_column} is 0 there")
    N, k = changes.shape
    theta = _changed_parameters(engine, base, names, changes)
    setting = np.full(N, float(reference.inputs[engine.power_setting]))
    start = np.repeat(start, N, axis=1)
    for _ in range(STEPS):
        inputs = {**{c: np.full(N, v) for c, v in reference.inputs.items()}, engine.power_setting: setting}
        found = engine.predict(
            inputs, theta, sensors=reference.columns, wrt=(*names, engine.power_setting), start=start
        )
        if not found.ok.all():
            raise PowerNotHeldError(found.reason(int(np.argmin(found.ok))) or "the engine cannot be computed there")
        left = found.y[:, 0] / wanted - 1.0
        J = found.jacobian
        by_setting = J[:, :, k]
        if np.all(np.abs(left) < SETTLED):
            with np.errstate(divide="ignore", invalid="ignore"):
                share = J[:, :1, :k] / by_setting[:, :1, None]
            slopes = J[:, 1:, :k] - by_setting[:, 1:, None] * np.where(np.isfinite(share), share, 0.0)
            return EqualPowerState(found.y[:, 1:], slopes, setting)
        if not np.all(np.abs(by_setting[:, 0] * setting / wanted) > SETTLED):
            raise PowerNotHeldError(f"{reference.fixed_column} does not follow {engine.power_setting} there")
        step = -left * wanted / by_setting[:, 0]
        setting = setting + np.clip(step, -LONGEST * np.abs(setting), LONGEST * np.abs(setting))
        start = found.x
    raise PowerNotHeldError(f"{reference.fixed_column} of the healthy engine is not reached")


@dataclass(frozen=True)
class AvailablePower:
    """Thrust or power `column` that N states of an engine deliver at the first limit that binds: value (N,) in the
    column's unit, NaN where it is not known; slopes (N, k): its derivatives by parameters; setting (N,): the power
    setting; limited_by (N,): column of the limit, "" where none is known; reason: why some are unknown."""

    column: str
    value: np.ndarray
    slopes: np.ndarray
    setting: np.ndarray
    limited_by: tuple[str, ...]
    reason: str = ""


OVER = 1e-6
"""Relative excess over a limit that is the solution's error."""


def solve_at_limits(
    engine: Engine,
    inputs: Mapping[str, float],
    base: Mapping[str, float],
    names: Sequence[str],
    changes: np.ndarray,
    limits: Mapping[str, float],
) -> AvailablePower:
    """What the states base + changes (N, k) of the parameters `names` deliver at the limits.

    Parameters
    ----------
    engine : Engine
        Model of the engine.
    inputs : mapping of str to float
        Operating condition, and the power setting to begin with.
    base : mapping of str to float
        Parameters of the healthy engine.
    names : sequence of str
        Parameters that have changed.
    changes : ndarray of shape (N, k)
        By how much, in their units.
    limits : mapping of str to float
        Column of the model, or the power setting → its limit, in the column's unit.

    Returns
    -------
    AvailablePower

    Raises
    ------
    PowerNotHeldError
        Where the engine gives neither thrust nor power.
    """
    delivered = next((c for c in (POWER, THRUST) if c in engine.model_columns), None)
    if delivered is None:
        raise PowerNotHeldError("the engine gives neither thrust nor power")
    theta = _changed_parameters(engine, base, names, changes)
    query = _LimitQuery(engine, inputs, theta, tuple(names), delivered, len(changes))
    found = {column: query.solve(column, limit) for column, limit in limits.items()}
    settings = np.stack([x.setting for x in found.values()])
    known = np.isfinite(settings)
    first = np.argmin(np.where(known, settings, np.inf), axis=0)
    state = np.arange(len(changes))
    setting = settings[first, state]
    value = np.stack([x.value for x in found.values()])[first, state]
    slopes = np.stack([x.slopes for x in found.values()])[first, state]
    over = query.exceeds(setting, limits)
    good = known.any(axis=0) & ~over
    columns = tuple(limits)
    reasons = [x.reason for x in found.values() if x.reason]
    return AvailablePower(
        delivered,
        np.where(good, value, np.nan),
        np.where(good[:, None], slopes, np.nan),
        np.where(good, setting, np.nan),
        tuple(columns[k] if ok else "" for k, ok in zip(first, good, strict=True)),
        "" if good.all() else reasons[0] if reasons else "another limit is exceeded there",
    )


@dataclass(frozen=True)
class _LimitSolution:
    """What N states deliver at one limit: setting, value (N,), slopes (N, k), NaN where it is not reached."""

    setting: np.ndarray
    value: np.ndarray
    slopes: np.ndarray
    reason: str = ""


@dataclass(frozen=True)
class _LimitQuery:
    """N states theta of an engine at one operating condition."""

    engine: Engine
    inputs: Mapping[str, float]
    theta: Mapping[str, Any]
    names: tuple[str, ...]
    delivered: str
    size: int

    def predict(self, setting: np.ndarray, columns: tuple[str, ...]) -> Prediction:
        """Columns of all states at power settings (N,), with derivatives by the parameters and the setting."""
        held = self.engine.power_setting
        inputs = {**{c: np.full(self.size, v) for c, v in self.inputs.items()}, held: setting}
        return self.engine.predict(inputs, self.theta, sensors=columns, wrt=(*self.names, held))

    def exceeds(self, setting: np.ndarray, limits: Mapping[str, float]) -> np.ndarray:
        """States (N,) that exceed some limit at power settings (N,)."""
        columns = tuple(c for c in limits if c != self.engine.power_setting)
        over = np.zeros(self.size, bool)
        for c in limits:
            if c == self.engine.power_setting:
                over |= setting > limits[c] * (1 + OVER)
        if columns:
            y = self.predict(np.nan_to_num(setting, nan=self.inputs[self.engine.power_setting]), columns).y
            over |= np.any(y > np.array([limits[c] for c in columns]) * (1 + OVER), axis=1)
        return over

    def solve(self, column: str, limit: float) -> _LimitSolution:
        """The power setting at which each state reaches one limit, by Newton steps that go back by half where the
        engine cannot be computed."""
        k = len(self.names)
        if column == self.engine.power_setting:
            found = self.predict(np.full(self.size, limit), (self.delivered,))
            reached = found.ok
            setting, value, slopes = np.full(self.size, limit), found.y[:, 0], found.jacobian[:, 0, :k]
        else:
            setting, reached, found = self._newton(column, limit)
            value, J = found.y[:, 1], found.jacobian
            with np.errstate(divide="ignore", invalid="ignore"):
                slopes = J[:, 1, :k] - J[:, 1, k:] * J[:, 0, :k] / J[:, 0, k:]
        return _LimitSolution(
            np.where(reached, setting, np.nan),
            np.where(reached, value, np.nan),
            np.where(reached[:, None], slopes, np.nan),
            "" if reached.all() else f"{column} does not reach {limit:g} in the range of the model",
        )

    def _newton(self, column: str, limit: float) -> tuple[np.ndarray, np.ndarray, Prediction]:
        k = len(self.names)
        setting = np.full(self.size, float(self.inputs[self.engine.power_setting]))
        good = setting.copy()
        for _ in range(2 * STEPS):
            found = self.predict(setting, (column, self.delivered))
            left, slope = found.y[:, 0] / limit - 1.0, found.jacobian[:, 0, k]
            reached = found.ok & (np.abs(left) < SETTLED) & (slope > 0)
            lost = ~found.ok | ~(slope > 0)
            if np.all(reached):
                break
            good = np.where(lost, good, setting)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = np.nan_to_num(np.clip(-left * limit / slope / setting, -LONGEST, LONGEST))
            setting = np.where(reached, setting, np.where(lost, 0.5 * (setting + good), setting * (1 + step)))
        return setting, reached, found


@dataclass(frozen=True)
class ChangeMoments:
    """Mean (k,) of the changes of parameters `names`, in their units, and covariance (k, k)."""

    names: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray

    def select(self, names: Sequence[str]) -> ChangeMoments:
        """The same of some of them, in their order."""
        at = [self.names.index(n) for n in names]
        return ChangeMoments(tuple(names), self.mean[at], self.covariance[np.ix_(at, at)])


@dataclass(frozen=True)
class Quantity:
    """A gain in the column's unit with its standard deviation; `share`: of the present value."""

    value: float
    deviation: float
    share: float
    share_deviation: float


@dataclass(frozen=True)
class Gain:
    """Gain of restoring one module, at equal power.

    Attributes
    ----------
    module, names : str, tuple of str
        The module and its parameters.
    temperature, fuel : Quantity
        Fall of turbine temperature and of fuel flow.
    """

    module: str
    names: tuple[str, ...]
    temperature: Quantity
    fuel: Quantity


def gains(
    engine: Engine,
    reference: PowerReference,
    base: Mapping[str, float],
    change: ChangeMoments,
    modules: Mapping[str, Sequence[str]],
) -> tuple[Gain, ...]:
    """Gain of restoring each module, name -> its parameters among those of `change`, the largest in temperature first.

    Raises PowerNotHeldError.
    """
    if not modules:
        return ()
    states = [change.mean]
    kept = []
    for names in modules.values():
        rest = np.array([n not in names for n in change.names], bool)
        kept.append(rest)
        states.append(np.where(rest, change.mean, 0.0))
    found = solve_equal_power(engine, reference, base, change.names, np.array(states))
    told = []
    for k, (module, names) in enumerate(modules.items(), start=1):
        gain = found.y[0] - found.y[k]
        slopes = found.slopes[0] - found.slopes[k] * kept[k - 1]
        told.append(_gain(module, tuple(names), gain, slopes, found.y[0], change.covariance))
    return tuple(sorted(told, key=lambda g: -abs(g.temperature.value)))


def change_gain(
    engine: Engine, reference: PowerReference, base: Mapping[str, float], before: np.ndarray, difference: ChangeMoments
) -> Gain:
    """What the change `difference` from the level `before` (k,) did lower temperature and fuel by at equal power.

    Raises PowerNotHeldError.
    """
    states = np.array([before, before + difference.mean])
    found = solve_equal_power(engine, reference, base, difference.names, states)
    gain = found.y[0] - found.y[1]
    return _gain("", difference.names, gain, -found.slopes[1], found.y[0], difference.covariance)


def _gain(
    module: str, names: tuple[str, ...], gain: np.ndarray, slopes: np.ndarray, now: np.ndarray, C: np.ndarray
) -> Gain:
    """gain, now (2,); slopes (2, k) of the gain; C (k, k)."""
    deviation = np.sqrt(np.maximum(np.einsum("yi,ij,yj->y", slopes, C, slopes), 0.0))
    temperature, fuel = (
        Quantity(float(v), float(s), float(v / y), float(s / y)) for v, s, y in zip(gain, deviation, now, strict=True)
    )
    return Gain(module, names, temperature, fuel)


NOT_KNOWN = "the engine file gives neither thrust nor power at an operating point that could be held"


@dataclass(frozen=True)
class WorkScope:
    """Gains of restoring the modules that an answer names.

    Attributes
    ----------
    gains : tuple of Gain
        The largest first.
    reference : PowerReference or None
        Operating point.
    reason : str
        Why there are no gains.
    """

    gains: tuple[Gain, ...] = ()
    reference: PowerReference | None = None
    reason: str = ""


class WorkScopeEstimator:
    """Work scopes of one monitored engine: its reference is found once."""

    def __init__(self, monitor: Monitor):
        self._monitor = monitor
        self.engine: Engine | None = plain_engine(monitor.engine)
        self._reference: PowerReference | None = None

    @property
    def base(self) -> Mapping[str, float]:
        """Parameters of the healthy engine as identified."""
        known = dict(zip(self._monitor.monitored, self._monitor.theta0.tolist(), strict=False))
        return {**self._monitor.base, **known}

    def reference(self, recorded: Mapping[str, float]) -> PowerReference | None:
        """Operating point of the gains; recorded: mean of what was recorded, for engines without another."""
        if self.engine is not None and self._reference is None:
            self._reference = choose_reference(self.engine, self.base, recorded)
        return self._reference

    def window_scope(self, found: IsolatedWindow, prior: SetPrior, largest: int | None = None) -> WorkScope | None:
        """Of a window as `isolate` answered it; None where nothing is named that stands, or by a method without a
        posterior. prior, largest: those of the isolation."""
        recorded = found.verdict.window.conditions
        if not found.named:
            return None
        if found.components is not None and found.score is not None:
            score = temper(found.score, found.components.adequacy.noise)
            named = [c for each in _members(found.components.components, found.components.ambiguity) for c in each]
            return self.inference_scope(infer_components(score, prior, largest), named, recorded)
        if found.diagnosis is None or found.diagnosis.inference is None:
            return None
        result = found.diagnosis.result
        named = [n for each in _members(result.isolated, result.ambiguity) for n in each]
        return self.inference_scope(found.diagnosis.inference, named, recorded)

    def inference_scope(self, belief: SetInference, named: Sequence[str], recorded: Mapping[str, float]) -> WorkScope:
        """Of the answer of one window; named: parameters or components."""
        mean, covariance = belief.moments()
        change = self._health_moments(belief.score.described, mean, covariance)
        chosen = {p.component for p in belief.score.described if {p.name, p.component} & {*named}}
        return self._scope(change, _modules(belief.score.described, change.names, chosen), recorded)

    def series_scope(
        self, events: Sequence[ChangeEvent], known: Mapping[str, Parameter], recorded: Mapping[str, float]
    ) -> WorkScope:
        """Of what changed during a history: the likeliest suspect of each event, beside those of the others."""
        healthy = [event for event in events if not event.instrument]
        change = _independent_moments(healthy, self.engine)
        modules: dict[str, list[str]] = {}
        for name in change.names:
            modules.setdefault(known[name].component, []).append(name)
        return self._scope(change, modules, recorded) if modules else WorkScope()

    def maintenance_gain(
        self, before: np.ndarray, difference: ChangeMoments, recorded: Mapping[str, float]
    ) -> tuple[Gain | None, str]:
        """What the change `difference` from the level `before` (k,) did lower temperature and fuel by at equal power;
        or None with the reason. recorded: as of `reference`."""
        reference = self.reference(recorded)
        if self.engine is None or reference is None:
            return None, NOT_KNOWN
        try:
            return change_gain(self.engine, reference, self.base, before, difference), ""
        except PowerNotHeldError as error:
            return None, str(error)

    def _health_moments(
        self, described: Sequence[Parameter], mean: np.ndarray, covariance: np.ndarray
    ) -> ChangeMoments:
        known = self.engine.parameters if self.engine is not None else {}
        at = [i for i, p in enumerate(described) if not p.belongs_to_instrument and p.name in known]
        return ChangeMoments(tuple(described[i].name for i in at), mean[at], covariance[np.ix_(at, at)])

    def _scope(
        self, change: ChangeMoments, modules: Mapping[str, Sequence[str]], recorded: Mapping[str, float]
    ) -> WorkScope:
        modules = {name: own for name, own in modules.items() if own}
        if not modules:
            return WorkScope()
        reference = self.reference(recorded)
        if self.engine is None or reference is None:
            return WorkScope(reason=NOT_KNOWN)
        try:
            return WorkScope(gains(self.engine, reference, self.base, change, modules), reference)
        except PowerNotHeldError as error:
            return WorkScope(reference=reference, reason=str(error))


def _members(answer: tuple[str, ...], one_of: AmbiguityGroup | None) -> tuple[tuple[str, ...], ...]:
    """The answer, and the members of the class where it is one."""
    return (answer, *one_of.members) if one_of is not None else (answer,)


def _modules(described: Sequence[Parameter], names: Sequence[str], chosen: set[str]) -> dict[str, list[str]]:
    """Components among the `chosen` with their parameters of `names`."""
    found: dict[str, list[str]] = {}
    for p in described:
        if p.name in names and p.component in chosen:
            found.setdefault(p.component, []).append(p.name)
    return found


def _independent_moments(events: Sequence[ChangeEvent], engine: Engine | None) -> ChangeMoments:
    """Changes now by several events, each independent of the others."""
    known = engine.parameters if engine is not None else {}
    names = tuple(dict.fromkeys(x.name for event in events for x in event.changes if x.name in known))
    place = {n: i for i, n in enumerate(names)}
    mean, covariance = np.zeros(len(names)), np.zeros((len(names), len(names)))
    for event in events:
        own = [q for q, x in enumerate(event.changes) if x.name in place]
        rows = [place[event.changes[q].name] for q in own]
        mean[rows] += [event.changes[q].now for q in own]
        covariance[np.ix_(rows, rows)] += event.covariance[np.ix_(own, own)]
    return ChangeMoments(names, mean, covariance)
