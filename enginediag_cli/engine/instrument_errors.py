"""Errors of instruments as parameters of a model: errors of its inputs, and drifts.

A model reads flight condition and power setting from instruments as well. An error of such an instrument makes the
model predict for another operating point. With the reading u of a channel,

    u_true = (u − b) / s    (bias b, scale s),        ∂Φ/∂b = −∂Φ/∂u / s,   ∂Φ/∂s = −∂Φ/∂u · (u − b) / s²

so that an error of an input is a parameter like any other, with the signature of a change of operating point.

An instrument that drifts has an error that grows with time. With the rate d, in the instrument's unit per hour, and t
the hours since the first record of the flight,

    y_read = y + d t,   ∂y/∂d = t          (an output)
    u_true = u_read − d t,   ∂Φ/∂d = −t ∂Φ/∂u          (an input of the model)

where t is an input column of the model. Whoever reads recordings writes it; it is 0 where no time was recorded. Bias,
scale and drift are forms of one fault of one instrument.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from enginediag_cli.engine.wrapped import MonitoredModel, PredictionRequest, WrappedModel
from enginediag_cli.parameters import FARTHEST_READING, Parameter
from enginediag_cli.units import UNITS, Unit, known_unit, split_column

FAMILY = "input"
PROBE_K, PROBE_SHARE = 2.5, 0.0075
"""By what a temperature probe is plausibly wrong: kelvin, or share of degrees Celsius where that is more: a
thermocouple of class 2, IEC 60584-1."""
ICE_K = 273.15
"""0 °C, where that share begins."""
SHARES = {
    "rotational speed": 0.003,
    "pressure": 0.005,
    "mass flow": 0.01,
    "volume flow": 0.01,
    "power": 0.01,
    "torque": 0.01,
}
"""Share of its reading by which an instrument is plausibly wrong: tachometers count, transducers are calibrated to half
a per cent, flow meters and torque meters drift by one. Humidities come from other systems, which an engineer does not
suspect for an engine's sake, and set positions of the engine are no readings."""
AIR_DATA = {"altitude": (75.0, "m"), "mach": (0.01, "")}
"""By what air data are plausibly wrong, by quantity, with unit: three times what their computers are good for (25 m
where heights are kept 300 m apart, and the Mach number of the same error of static pressure). Pitot tubes and static
ports are blocked, bent and iced, and an engine at another height than was read looks changed as a whole."""
OF_NOISE = 3.0
"""How far an instrument is plausibly wrong in standard deviations of its stated noise: as far as one of an output."""
BOUND = 10.0
"""Bounds of an error in its plausible sizes: no physical limit, the model must only stay computable."""


@dataclass(frozen=True)
class InputError:
    """One form of the error of an input column: its parameter, and whether it multiplies the reading or is added to
    it."""

    column: str
    parameter: Parameter
    multiplies: bool

    def corrected(self, read: Any, value: Any) -> Any:
        """The true input that was read so."""
        return read / value if self.multiplies else read - value

    def slope(self, read: Any, value: Any) -> Any:
        """How the true input falls with the parameter: ∂u_true/∂value."""
        return -read / np.square(value) if self.multiplies else np.asarray(-1.0)


class InputErrors(WrappedModel):
    """`engine` with the errors of some of its input channels as further parameters; all else is the engine's."""

    def __init__(self, engine: MonitoredModel, errors: Sequence[InputError]):
        self.errors: dict[str, InputError] = {error.parameter.name: error for error in errors}
        super().__init__(engine, {name: error.parameter for name, error in self.errors.items()})

    @staticmethod
    def wrap(
        engine: MonitoredModel, columns: Sequence[str] | None = None, readings: Mapping[str, float] | None = None
    ) -> MonitoredModel:
        """The engine with the errors of the input `columns` (default: of all that are instruments'), or as it is where
        there are none; readings: column → largest reading that was seen, in its unit."""
        chosen, seen = engine.inputs if columns is None else columns, readings or {}
        found = [error for column in chosen for error in forms(engine, column, seen.get(column, 0.0))]
        errors = [error for error in found if error.parameter.name not in engine.parameters]
        return InputErrors(engine, errors) if errors else engine

    def _predict(self, request: PredictionRequest) -> Any:
        """Φ and ∂Φ/∂θ as the engine gives them, at the true inputs; those of the question are as they were read."""
        true, slopes = dict(request.inputs), dict[str, Any]()
        for name, error in sorted(self.errors.items(), key=lambda item: item[1].multiplies):  # the bias comes off first
            value = np.asarray(request.own.get(name, error.parameter.nominal), float)
            read = np.asarray(true[error.column], float)
            changed = bool(np.any(value != error.parameter.nominal))
            if changed and error.multiplies:
                slopes.update({n: slopes[n] / value for n in slopes if self.errors[n].column == error.column})
            if name in request.wrt:
                slopes[name] = error.slope(read, value)
            if changed:
                true[error.column] = error.corrected(read, value)
        return self._predict_inner_scaled(
            request, {name: self.errors[name].column for name in slopes}, slopes, inputs=true
        )


def forms(engine: MonitoredModel, column: str, largest: float = 0.0) -> tuple[InputError, ...]:
    """The error of an input channel as a bias and as a scale, none where no instrument of the engine is read; of equal
    size at the `largest` reading, where 0 at that which the engine file expects. The usual form alone where neither is
    known, and of what may be negative: a deviation from ISA has no scale."""
    usual = suspected(engine, column)
    size = largest or _largest(engine, column)
    if usual is None:
        return ()
    if not size > 0 or getattr(engine, "envelope", {}).get(column, (0.0, 0.0))[0] < 0:
        return (_reaching(usual, FARTHEST_READING if usual.multiplies else 0.0),)
    usual = _reaching(usual, FARTHEST_READING * (1.0 if usual.multiplies else size))
    by = 1.0 / size if not usual.multiplies else size
    sigma, reach = by * usual.parameter.prior_sigma, by * (usual.parameter.upper - usual.parameter.nominal)
    other = _error(column, not usual.multiplies, sigma, reach if usual.multiplies else min(reach, 0.5))
    return usual, _reaching(other, FARTHEST_READING * (size if usual.multiplies else 1.0))


def _reaching(error: InputError, farthest: float) -> InputError:
    """The error that may be as large as `farthest`, in its unit; 0: as its bounds, where no size of a reading is
    known."""
    p = error.parameter
    return replace(error, parameter=replace(p, reach=(farthest or p.upper - p.nominal) / p.prior_sigma))


def suspected(engine: MonitoredModel, column: str) -> InputError | None:
    """The usual form of the error of an input channel, by the dimension of its column; None where no instrument of the
    engine is read."""
    quantity, unit = split_column(column)
    kind = known_unit(unit)
    if quantity in AIR_DATA:
        return _air_data_error(engine, column)
    if kind is None or (kind.dimension != "temperature" and kind.dimension not in SHARES):
        return None
    multiplies = kind.dimension != "temperature"
    stated = _stated(engine, column, multiplies)
    usual = SHARES[kind.dimension] if multiplies else _probe_error(kind, _largest(engine, column))
    sigma = OF_NOISE * stated if stated else usual
    # a scale stays clear of zero
    reach = min(BOUND * sigma, 0.5) if multiplies else BOUND * max(sigma, usual)
    return _error(column, multiplies, sigma, reach)


def _air_data_error(engine: MonitoredModel, column: str) -> InputError:
    """The error of a height or a Mach number, a bias whatever its unit."""
    quantity, unit = split_column(column)
    size, of = AIR_DATA[quantity]
    usual = size * UNITS[of].factor / UNITS[unit].factor if unit in UNITS and of in UNITS else size
    stated = _stated(engine, column, False)
    sigma = OF_NOISE * stated if stated else usual
    return _error(column, False, sigma, BOUND * max(sigma, usual))


def _error(column: str, multiplies: bool, sigma: float, reach: float) -> InputError:
    """The error of this column, plausible up to `sigma` and possible up to `reach`."""
    quantity, unit = split_column(column)
    nominal, what = (1.0, "scale") if multiplies else (0.0, "bias")
    part = f"{quantity} reading"
    return InputError(
        column,
        Parameter(
            f"{FAMILY}.{quantity}.{what}",
            FAMILY,
            nominal,
            nominal - reach,
            nominal + reach,
            sigma,
            "1" if multiplies else unit,
            f"{what} of the recorded input {column}",
            f"{FAMILY}.{quantity}",
            what,
            f"{part} scale factor" if multiplies else f"{part} bias",
            part,
        ),
        multiplies,
    )


def _stated(engine: Any, column: str, share: bool) -> float | None:
    """Noise of one reading as the engine file states it, as a share of the reading or in the column's unit."""
    declared = getattr(engine, "declared", {})
    sensor = (declared.get("sensors") or {}).get(column) or {}
    block = declared.get("mismatch") or {}
    of_reading = (block.get("input_noise_share") or {}).get(column)
    sigma = (block.get("input_noise") or {}).get(column) or sensor.get("noise_sigma")
    size = sensor.get("maximum") or _largest(engine, column)
    if share:
        return of_reading or (sigma / size if sigma and size else None)
    return sigma


def _largest(engine: Any, column: str) -> float:
    """The largest reading of an input that the engine file expects, 0 where it does not say."""
    return float(getattr(engine, "envelope", {}).get(column, (0.0, 0.0))[1])


def _probe_error(unit: Unit, largest: float) -> float:
    """What a temperature probe is plausibly wrong by, in its unit."""
    celsius = unit.factor * largest + unit.offset - ICE_K
    return max(PROBE_K, PROBE_SHARE * celsius) / unit.factor


ELAPSED = "elapsed_h"
"""Input column: hours since the first record of the flight."""
DRIFT = "drift"
"""Quantity of such a parameter."""


class InstrumentDrifts(WrappedModel):
    """`model` with the drifts of instruments as further parameters: column → its parameter, of outputs and of inputs;
    all else is the model's."""

    def __init__(self, model: MonitoredModel, outputs: Mapping[str, Parameter], inputs: Mapping[str, Parameter]):
        self._outputs = {p.name: column for column, p in outputs.items()}
        self._inputs = {p.name: column for column, p in inputs.items()}
        super().__init__(model, {p.name: p for p in (*outputs.values(), *inputs.values())})
        self.optional_inputs = {**model.optional_inputs, ELAPSED: 0.0}

    @staticmethod
    def from_biases(
        model: MonitoredModel, outputs: Mapping[str, Parameter], inputs: Mapping[str, Parameter]
    ) -> InstrumentDrifts:
        """With a drift for each instrument of which the bias is known, by column: it may reach in an hour what is
        plausible of the bias."""
        return InstrumentDrifts(
            model,
            {c: drift_parameter(p) for c, p in outputs.items()},
            {c: drift_parameter(p) for c, p in inputs.items()},
        )

    def _predict(self, request: PredictionRequest) -> Any:
        true = dict(request.inputs)
        hours = np.asarray(true.pop(ELAPSED, 0.0), float)
        rates = {name: np.asarray(value, float) for name, value in request.own.items() if np.any(value)}
        for name, rate in rates.items():
            if name in self._inputs:
                true[self._inputs[name]] = np.asarray(true[self._inputs[name]], float) - rate * hours
        slopes = {name: -hours for name in request.wrt if name in self._inputs}
        inner = tuple(name for name in request.wrt if name not in self._outputs)
        like = {name: self._inputs[name] for name in slopes}
        plain = replace(request, wrt=inner)
        found = self._predict_inner_scaled(plain, like, slopes, inputs=true)
        drifting = [name for name in (*request.wrt, *rates) if name in self._outputs]
        return self._add_drifts(found, request.wrt, inner, hours, rates) if drifting else found

    def _add_drifts(
        self,
        found: Any,
        wrt: tuple[str, ...],
        inner: tuple[str, ...],
        hours: np.ndarray,
        rates: Mapping[str, np.ndarray],
    ) -> Any:
        """The prediction with the drifts of outputs in it, and their columns among its sensitivities."""
        y, columns = np.array(found.y, float), list(found.columns)
        J = np.zeros((*y.shape, len(wrt)))
        if inner:
            J[:, :, [k for k, name in enumerate(wrt) if name in inner]] = found.jacobian
        for name, column in self._outputs.items():
            if column in columns:
                j = columns.index(column)
                if name in rates:
                    y[:, j] += rates[name] * hours
                if name in wrt:
                    J[:, j, wrt.index(name)] = hours
        result = copy(found)  # predictions are frozen
        for attribute, value in (("y", y), ("jacobian", J), ("wrt", wrt)):
            object.__setattr__(result, attribute, value)
        return result


def drift_parameter(bias: Parameter) -> Parameter:
    """The drift of the instrument whose bias this is."""
    per_hour = f"{bias.shown_unit or '1'}/h"
    return replace(
        bias,
        name=f"{bias.component}.{DRIFT}",
        nominal=0.0,
        lower=bias.lower - bias.nominal,
        upper=bias.upper - bias.nominal,
        unit=per_hour,
        description=f"drift of the {bias.part}",
        quantity=DRIFT,
        words=f"{bias.part} drift",
        roams=None,
    )
