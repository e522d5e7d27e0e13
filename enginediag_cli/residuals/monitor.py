"""What is watched: parameters, sensors, noise and everything uncertain about nominal, ready to predict with.

Parameters come in three kinds. *Monitored* ones may have changed. *Uncertain* ones were identified with an
error, and *offsets* of sensors differ from one recording to the next; both are nuisance, of covariance
`uncertainty`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import filter as matching
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from enginediag_cli.config.fields import near
from enginediag_cli.engine.instrument_errors import DRIFT, InputErrors, InstrumentDrifts
from enginediag_cli.engine.wrapped import LagModel, MonitoredModel
from enginediag_cli.error_model.sizes import MapSlopes, map_slopes
from enginediag_cli.errors import DataError
from enginediag_cli.identification.instruments import SensorLag
from enginediag_cli.identification.problem import OffsetPrior
from enginediag_cli.intake.agreement import AgreementCheck
from enginediag_cli.intake.comparison import nominal_reference
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.relinearise import EstimatePrior
from enginediag_cli.residuals.statistics import ParameterFrame
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.identification.nominal import Nominal
    from enginediag_cli.intake.selection import NominalBaseline

AnyMonitor = TypeVar("AnyMonitor", bound="Monitor")

DIGITS = 16
"""Hexadecimal digits of a hash that distinguishes files: an accident in 10¹⁹ passes."""
SEEN = 12
"""Operating points at which readings are computed, and over which the effect of a change on map coordinates is
averaged; it varies little."""
PRIOR_SHARE = 0.5
"""Spread of a change in prior standard deviations, for the point of linearisation: the middle one of the sizes that
isolation takes for plausible."""


@dataclass(frozen=True)
class Offset:
    """An instrument's error, constant in one recording: `bias` in the column's unit or `scale`, a fraction. Of the
    output number `sensor`, or, where it is named, of the input `column`; that is linear in its size, and stays at 0.
    Of kind `lagging` it is what a reading lags by, amounts `lags` of the deviations that `LagModel` gives; that
    is linear, too."""

    sensor: int
    kind: str
    column: str = ""
    lags: tuple[float, ...] = ()


@dataclass(frozen=True)
class Monitor:
    """Engine with p parameters of interest (monitored, then uncertain, then offsets) and m sensors.

    base: values of all identified parameters; meaning: what the monitored are, by name; theta0, prior_sigma, lower,
    upper (p,); uncertainty (p, p). nominal: the fingerprint of the nominal state, to which statistics are bound.
    smooth: whether `compact` finds its fit good enough, None where that is not known. slopes: how wrong the maps may
    make the effect of a change, None where they are taken to be right. lagging: readings that lag where the engine
    moves, which `with_lagging` makes part of what is uncertain. doubtful: the monitor with what is uncertain about
    nominal, of one that goes without.
    """

    engine: MonitoredModel
    sensors: tuple[str, ...]
    base: Mapping[str, float]
    names: tuple[str, ...]
    monitored: tuple[str, ...]
    meaning: Mapping[str, Parameter]
    offsets: tuple[Offset, ...]
    theta0: np.ndarray
    prior_sigma: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    uncertainty: np.ndarray
    noise: NoiseModel
    envelope: Any = None
    nominal: str = ""
    smooth: bool | None = None
    slopes: MapSlopes | None = None
    sensor_lags: tuple[SensorLag, ...] = ()
    uncertain_monitor: Monitor | None = None

    @cached_property
    def precision(self) -> np.ndarray:
        """Inverse covariance (p, p) that holds the re-estimate: of a change plus uncertainty of nominal.

        A change is held by half its prior standard deviation: along directions that the data hardly determine a
        looser estimate wanders far from every plausible explanation, and the model is linearised at a wrong place.
        """
        change = np.zeros(len(self.names))
        change[: len(self.monitored)] = (PRIOR_SHARE * self.prior_sigma[: len(self.monitored)]) ** 2
        covariance = self.uncertainty + np.diag(change)
        scale = self.prior_sigma
        scaled = covariance / scale / scale[:, None] + 1e-10 * np.eye(len(scale))
        return np.asarray(np.linalg.inv(scaled) / scale / scale[:, None])

    @property
    def frame(self) -> ParameterFrame:
        """What statistics of this monitor are about."""
        return ParameterFrame(self.names, self.theta0, self.prior_sigma, self.meaning)

    @property
    def hold(self) -> EstimatePrior:
        """Where the re-estimate of a window begins and what holds it: only the monitored parameters move."""
        return EstimatePrior(self.theta0, self.precision, len(self.monitored), (self.lower, self.upper))

    def drop_parameters(self, names: Collection[str]) -> Monitor:
        """The same with `names`, of the monitored parameters, taken not to have changed; what is uncertain about them
        stays, for it may make up for what is uncertain about others."""
        if not names:
            return self
        kept = [i for i, name in enumerate(self.monitored) if name not in names]
        gone = [i for i, name in enumerate(self.monitored) if name in names]
        order = [*kept, *gone, *range(len(self.monitored), len(self.names))]
        monitored = tuple(self.monitored[i] for i in kept)
        return replace(
            self, **self.parameter_fields(order), monitored=monitored, slopes=self.slopes and self.slopes.select(kept)
        )

    def parameter_fields(self, order: Sequence[int]) -> dict[str, Any]:
        """The fields that describe parameters, for those at these positions."""
        rows = np.array(order, dtype=int)
        vectors = {name: getattr(self, name)[rows] for name in ("theta0", "prior_sigma", "lower", "upper")}
        names = tuple(self.names[i] for i in rows)
        return {"names": names, **vectors, "uncertainty": self.uncertainty[np.ix_(rows, rows)]}

    def add_nuisance(
        self: AnyMonitor, names: Sequence[str], unit: np.ndarray, covariance: np.ndarray, offsets: Sequence[Offset] = ()
    ) -> AnyMonitor:
        """The same monitor with k further nuisance parameters, at 0 and without bounds.

        unit (k,): the unit of each; covariance (k, k). offsets: which instruments err so, where the parameters are
        errors of instruments.
        """
        p, k = len(self.names), len(names)
        uncertainty = np.zeros((p + k, p + k))
        uncertainty[:p, :p], uncertainty[p:, p:] = self.uncertainty, covariance
        return replace(
            self,
            names=(*self.names, *names),
            offsets=(*self.offsets, *offsets),
            theta0=np.append(self.theta0, np.zeros(k)),
            prior_sigma=np.append(self.prior_sigma, unit),
            lower=np.append(self.lower, np.full(k, -np.inf)),
            upper=np.append(self.upper, np.full(k, np.inf)),
            uncertainty=uncertainty,
        )

    def predict(
        self,
        inputs: Mapping[str, np.ndarray],
        theta: np.ndarray,
        *,
        nuisance: bool = True,
        start: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Any]:
        """y (N, m), J (N, m, p), ok (N,) and the engine's prediction, theta (p,) or one row per record.

        Without `nuisance`, J has only the columns of the monitored parameters. start: the unknowns `x` of an
        earlier prediction of the same records, which the engine begins with.
        """
        q = len(self.names) - len(self.offsets)
        # a parameter that is the same for all records goes in as one number, which the engine computes faster
        same = theta.ndim == 1 or np.all(theta == theta[:1], axis=0)
        shared = np.broadcast_to(same, theta.shape[-1:])
        first = theta if theta.ndim == 1 else theta[0]
        values: dict[str, Any] = dict(self.base)
        values.update({name: float(first[i]) if shared[i] else theta[:, i] for i, name in enumerate(self.names[:q])})
        wrt = self.names[:q] if nuisance else self.monitored
        read = tuple(dict.fromkeys(o.column for o in self.offsets if o.column)) if nuisance else ()
        known: dict[str, Any] = {} if start is None else {"start": start}
        prediction = self.engine.predict(inputs, values, sensors=self.sensors, wrt=(*wrt, *read), **known)
        y, J = np.asarray(prediction.y), np.asarray(prediction.jacobian)
        J, along = J[:, :, : len(wrt)], J[:, :, len(wrt) :]
        if self.offsets:
            factor, shift = np.ones_like(y), np.zeros_like(y)
            extra = np.zeros((*y.shape, len(self.offsets)))
            behind: np.ndarray | None = None
            for i, offset in enumerate(self.offsets):
                if offset.column and nuisance:
                    by = inputs[offset.column][:, None] if offset.kind == "scale" else 1.0
                    extra[:, :, i] = -by * along[:, :, read.index(offset.column)]
                elif offset.column:
                    continue
                elif offset.kind == "lagging":
                    if nuisance:
                        if behind is None:
                            behind = self.engine.deviations(inputs, self.sensors, len(y))  # type: ignore[attr-defined]
                        extra[:, offset.sensor, i] = behind[:, offset.sensor] @ offset.lags
                elif offset.kind == "bias":
                    shift[:, offset.sensor] += theta[..., q + i]
                    extra[:, offset.sensor, i] = 1.0
                else:
                    factor[:, offset.sensor] += theta[..., q + i]
                    extra[:, offset.sensor, i] = y[:, offset.sensor]
            J = np.concatenate([J * factor[:, :, None], *([extra] if nuisance else [])], axis=2)
            y = y * factor + shift
        return y, J, np.asarray(prediction.ok), prediction


def monitor_from_nominal(
    engine: MonitoredModel, nominal: Nominal, patterns: Sequence[str] = (), sensors: Sequence[str] = ()
) -> Monitor:
    """Make the monitor of an identified engine.

    Parameters
    ----------
    engine : MonitoredModel
    nominal : Nominal
    patterns : sequence of str
        Names or shell patterns of the parameters to monitor; by default those that the engine file monitors.
    sensors : sequence of str
        Columns to use; by default those that were identified.

    Returns
    -------
    Monitor

    Raises
    ------
    DataError
        For names that do not exist.
    """
    from enginediag_cli.identification.nominal_file import fingerprint

    used = tuple(sensors) or nominal.sensors
    absent = [c for c in used if c not in nominal.sensors]
    if absent:
        raise DataError(f"no noise was identified for {', '.join(absent)}; nominal has {', '.join(nominal.sensors)}")
    if nominal.sensor_lags:
        engine = LagModel(engine, nominal.theta0, nominal.sensor_lags[0].lags_s)
    plain = engine
    if nominal.error_model is not None:
        engine = nominal.error_model.wrap(engine)
    monitored = match_parameters(plain, patterns)
    errors = {e.name: e.standard_error for e in nominal.estimates}
    uncertain = tuple(e.name for e in nominal.estimates if e.standard_error > 0 and e.name not in monitored)
    slopes = _slopes(plain, nominal, monitored)
    known_offsets = [o for o in nominal.offsets if o.sensor in used or o.sensor in nominal.inputs]
    # a window is short beside the wander of an actuator; the recordings that were identified were not
    known_offsets += [OffsetPrior(column, "bias", s) for column, s in getattr(engine, "wanders", {}).items()]
    offsets = tuple(
        Offset(used.index(o.sensor), o.kind) if o.sensor in used else Offset(-1, o.kind, o.sensor)
        for o in known_offsets
    )
    spread = [o.next_sigma for o in known_offsets]
    names = (*monitored, *uncertain, *(f"offset.{o.sensor}.{o.kind}" for o in known_offsets))
    known = {**{name: p.nominal for name, p in engine.parameters.items()}, **nominal.theta0}
    inner = names[: len(names) - len(offsets)]
    free = np.full(len(offsets), np.inf)
    return Monitor(
        engine=engine,
        sensors=used,
        base=nominal.theta0,
        names=names,
        monitored=monitored,
        meaning=_meaning(engine, nominal, used, monitored),
        offsets=offsets,
        theta0=np.array([*(known[name] for name in inner), *np.zeros(len(offsets))], float),
        prior_sigma=np.array(
            [
                *(engine.parameters[name].prior_sigma for name in monitored),
                *(errors[name] for name in uncertain),
                *spread,
            ],
            float,
        ),
        lower=np.concatenate([[engine.parameters[name].lower for name in inner], -free]),
        upper=np.concatenate([[engine.parameters[name].upper for name in inner], free]),
        uncertainty=_uncertainty(nominal, inner, spread),
        noise=noise_model(nominal, used),
        envelope=nominal.envelope,
        nominal=fingerprint(nominal),
        smooth=None if patterns else nominal.smooth,
        slopes=slopes,
        sensor_lags=nominal.sensor_lags,
    )


def _meaning(
    engine: MonitoredModel, nominal: Nominal, sensors: Sequence[str], monitored: Sequence[str]
) -> dict[str, Parameter]:
    """What the monitored parameters are, biases of sensors with how far they reach by what these read where
    identification was."""
    found = {name: engine.parameters[name] for name in monitored}
    if any(p.belongs_to_sensor and p.quantity == "bias" for p in found.values()):
        values = {name: v for name, v in nominal.theta0.items() if name in engine.parameters}
        answer = engine.predict(sample_envelope(nominal.envelope), values, sensors=tuple(sensors))
        read = np.abs(np.asarray(answer.y)[np.asarray(answer.ok)]).max(axis=0, initial=0.0)
        for column, largest in zip(sensors, read.tolist(), strict=True):
            found |= {p.name: p for p in engine.sensors[column].parameters(largest) if p.name in found}
    return found


def sample_envelope(envelope: Any, count: int = SEEN) -> dict[str, np.ndarray]:
    """So many of the operating points that identification saw, evenly chosen, column -> (count,)."""
    points = np.asarray(envelope.points)
    at = np.unique(np.linspace(0, len(points) - 1, count).round().astype(int))
    return {c: points[at, i] for i, c in enumerate(envelope.inputs)}


def _slopes(engine: MonitoredModel, nominal: Nominal, monitored: tuple[str, ...]) -> MapSlopes | None:
    """Slopes of the maps at some of the operating points that identification saw."""
    if nominal.error_model is None:
        return None
    inputs = sample_envelope(nominal.envelope)
    theta = {name: v for name, v in nominal.theta0.items() if name in engine.parameters}
    return map_slopes(engine, nominal.error_model, monitored, inputs, theta)


def noise_model(nominal: Nominal, columns: Sequence[str]) -> NoiseModel:
    """Noise of the sensors, with the chance that is in it where it is the variance that the fit left.

    Where σ is the error of prediction of left-out blocks it holds the scatter of the sensors, the error of the model
    and, which the test adds once more, that of the identified parameters: a bound that lies above the noise, not an
    estimate with so many degrees of freedom that lies on either side of it. Test statistics of the flight that it
    came from are then below their mean, and room for chance in σ on top of that would only hide faults.
    """
    noise = {n.sensor: n for n in nominal.noise}
    found = [noise[c] for c in columns]
    bound = np.array([n.sigma_from == "cross_validation" for n in found])
    readings = np.array([max(n.degrees, 1.0) if n.sigma_from == "fit" else np.inf for n in found])
    rho_error = np.where(bound, 0.0, [n.rho1_error for n in found])
    kurtosis = np.where(bound, 0.0, [n.kurtosis for n in found])
    return NoiseModel(
        np.array([n.sigma for n in found]),
        np.array([n.rho1 for n in found]),
        readings=readings if np.isfinite(readings).any() or rho_error.any() else None,
        rho_error=rho_error,
        rho_common=np.where(bound, 0.0, [n.rho1_common for n in found]),
        kurtosis=kurtosis if kurtosis.any() else None,
    )


def match_parameters(engine: MonitoredModel, patterns: Sequence[str]) -> tuple[str, ...]:
    """Parameters that the patterns name, in the engine's order; DataError for a pattern that names none."""
    if not patterns:
        return tuple(engine.monitored)
    chosen: set[str] = set()
    for pattern in patterns:
        hits = matching(list(engine.parameters), pattern)
        if not hits:
            raise DataError(f"no parameter of {engine.name} matches {pattern!r}; {near(pattern, engine.parameters)}")
        chosen.update(hits)
    return tuple(name for name in engine.parameters if name in chosen)


def _uncertainty(nominal: Nominal, names: Sequence[str], spread: Sequence[float]) -> np.ndarray:
    """Covariance of the identified among `names`, zero for what was not identified, then of the offsets."""
    position = {e.name: i for i, e in enumerate(nominal.estimates)}
    C = np.zeros((len(names) + len(spread),) * 2)
    here = [i for i, name in enumerate(names) if name in position]
    there = [position[names[i]] for i in here]
    C[np.ix_(here, here)] = nominal.covariance[np.ix_(there, there)]
    C[range(len(names), len(C)), range(len(names), len(C))] = np.square(spread)
    return C


def _bleed_valves(engine: Any) -> list[str]:
    """Bleed valves that may stand open, of compressors whose flow is not divided behind them: ahead of a splitter there
    is none. Vanes off their schedule are no suspects by themselves: to first order they are a change of flow
    capacity."""
    network = getattr(engine, "network", None)
    if network is None:
        return []
    divided = {c.values["from"] for c in network.components if c.TYPE == "splitter"}
    outlets = {f"bleed.{c.name}.fraction": c.values["to"] for c in network.components if c.TYPE == "compressor"}
    return [name for name, station in outlets.items() if name in engine.parameters and station not in divided]


def _add_drifts(engine: MonitoredModel, sensors: Sequence[str]) -> MonitoredModel:
    """The engine with a drift of every instrument that has a bias, of these sensors and of the inputs."""
    known = {p.component: p for p in engine.parameters.values() if p.belongs_to_instrument and p.quantity == "bias"}
    outputs = {c: known[s] for c in sensors if (s := f"sensor.{split_column(c)[0]}") in known}
    inputs = {c: known[s] for c in engine.inputs if (s := f"input.{split_column(c)[0]}") in known}
    return InstrumentDrifts.from_biases(engine, outputs, inputs)


def build_monitor(
    baseline: NominalBaseline, patterns: Sequence[str] = (), *, sensors: bool = False, drifts: bool = False
) -> Monitor:
    """Build the monitor of a baseline.

    Parameters
    ----------
    baseline : NominalBaseline
    patterns : sequence of str
        Parameters to monitor, as in `monitor_from_nominal`.
    sensors : bool
        Whether bias and scale of every sensor in use and of every input channel, and bleed valves, may have changed,
        too.
    drifts : bool
        Whether these instruments may drift as well.

    Returns
    -------
    Monitor

    Raises
    ------
    DataError
        For a pattern that names nothing.
    """
    nominal = baseline.nominal
    engine: MonitoredModel = baseline.engine
    if sensors or patterns:
        seen = nominal.envelope
        largest = dict(zip(seen.inputs, np.abs(np.asarray(seen.points)).max(axis=0).tolist(), strict=True))
        engine = InputErrors.wrap(engine, readings=largest)
    if sensors and drifts:
        engine = _add_drifts(engine, nominal.sensors)
    monitor = monitor_from_nominal(engine, nominal, patterns)
    if sensors:
        known = [p for column in monitor.sensors for p in engine.sensors[column].parameters()]
        wrong = [p.name for p in known if p.quantity in ("bias", "scale")]
        wrong += [p.name for p in engine.parameters.values() if p.belongs_to_instrument and not p.belongs_to_sensor]
        wrong += [p.name for p in engine.parameters.values() if p.belongs_to_sensor and p.quantity == DRIFT]
        wrong += _bleed_valves(engine)
        added = [name for name in wrong if name not in monitor.monitored]
        monitor = monitor_from_nominal(engine, nominal, (*monitor.monitored, *added))
    # statistics are bound to the engine that made them, too, where it is not the one identified
    changed = baseline.changed_engine and f" engine {baseline.changed_engine[:DIGITS]}"
    return replace(monitor, nominal=monitor.nominal + changed)


def recording_agreement(monitor: Monitor) -> AgreementCheck | None:
    """What recordings are compared with before they are judged by a monitor; None for one of a model without an engine
    file."""
    if not hasattr(monitor.engine, "network"):
        return None
    identified = dict(zip(monitor.names, monitor.theta0.tolist(), strict=False))
    values = {n: float(v) for n, v in {**monitor.base, **identified}.items() if n in monitor.engine.parameters}
    yardstick = nominal_reference(monitor.engine, values, monitor.sensors, monitor.noise.sigma)
    return AgreementCheck(yardstick, monitor.engine)
