"""Sizing at the design point, and what would cure a design point that cannot be met."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from enginediag_cli.config.checked import Checked
from enginediag_cli.config.hints import near
from enginediag_cli.engine.components import Component
from enginediag_cli.engine.components.burner import Burner
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.components.mixer import Mixer, PressureMismatchError
from enginediag_cli.engine.components.recuperator import ColdGasError
from enginediag_cli.engine.components.splitter import Splitter
from enginediag_cli.engine.controls.orientation import orient
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.gas import T_FIT
from enginediag_cli.engine.network import Network
from enginediag_cli.errors import ConfigError, Problem

FAN_RATIOS = (1.05, 12.0)
"""Pressure ratios between which that of a fan is sought: from hardly any compression to more than any fan gives."""
BYPASS_RATIOS = (0.02, 20.0)
"""Where a value that lets two flows mix is looked for."""
SIZING_PASSES = 60
"""Of all components, where one assumes what another gives: each gains a digit or more, since a burner's exit
temperature hardly leaves a way back."""
HALVINGS = 40
"""Of that range: far more than the digits that are told."""


def size(network: Network, values: Mapping[str, Any], checked: Checked) -> None:
    """Runs the components through the design point. Raises ConfigError, with the value that would do where there is
    one."""
    try:
        _run(network, values)
    except PressureMismatchError as error:
        problem = Problem(
            checked.mark(("design",)),
            f"the design point cannot be met: {error}",
            _equal_pressures(network, values, error),
        )
        raise ConfigError([problem]) from error
    except ColdGasError as error:
        problem = Problem(
            checked.mark(("design",)), f"the design point cannot be met: {error}", _warm_enough(network, values)
        )
        raise ConfigError([problem]) from error
    except ValueError as error:
        raise ConfigError([Problem(checked.mark(("design",)), f"the design point cannot be met: {error}")]) from error
    _controls(network, values, checked)


def _controls(network: Network, values: Mapping[str, Any], checked: Checked) -> None:
    """Set points and signs of the controls, at the sized design point."""
    assert network.design_point is not None
    leaves = dict(network.design_point.leaves)
    try:
        orient(network, leaves)
    except ValueError as error:
        raise ConfigError([Problem(checked.mark(("controls",)), str(error))]) from error
    except KeyError as error:
        columns = network.columns(network.design_point)
        problem = Problem(
            checked.mark(("controls",)), f"the model has no column '{error.args[0]}'", near(error.args[0], columns)
        )
        raise ConfigError([problem]) from error


def _run(network: Network, values: Mapping[str, Any]) -> None:
    own = {column: x for c in network.components for column, x in c.at_design().items()}
    inputs = {c: np.array([values["design"].get(c, own.get(c, 0.0))]) for c in network.inputs()}
    x: dict[str, Any] = {u.name: np.array([u.start]) for c in network.components for u in c.unknowns()}
    x |= {f"{name}.corrected_speed": np.array([1.0]) for name in network.shafts}
    leaves: dict[str, Any] = {**network.neutral, **{p.name: p.nominal for p in network.parameters()}, **x, **inputs}
    for _ in range(SIZING_PASSES):
        with np.errstate(all="ignore"):
            network.size(Evaluation(network.gas, 1, leaves))
        if all(c.settled() for c in network.components):
            assert network.design_point is not None
            network.coupling.check_design(network.design_point)
            return
    open_still = ", ".join(c.name for c in network.components if not c.settled())
    raise ValueError(f"{open_still}: no temperature behind it agrees with what follows from it")


def _equal_pressures(network: Network, values: Mapping[str, Any], error: PressureMismatchError) -> str:
    """The fan pressure ratio or the bypass ratio with which both flows reach the mixer at one total pressure."""
    mixer = next(c for c in network.components if isinstance(c, Mixer) and c.name == error.mixer)
    splitter = next((c for c in network.components if isinstance(c, Splitter)), None)
    if splitter is None:
        return ""
    fan = _feeding(network, splitter)
    found = []
    searched: list[tuple[Component, str, tuple[float, float]]] = [(fan, "pressure_ratio", FAN_RATIOS)] if fan else []
    searched.append((splitter, "bypass_ratio", BYPASS_RATIOS))
    for component, key, within in searched:

        def surplus(x: float, component: Component = component, key: str = key) -> float:
            return _ratio_at(network, values, mixer, component, key, x) - 1.0

        value = _bisected(surplus, *within)
        if value is not None:
            found.append(f"{component.name}: {key}: {value:.3f}")
    return f"both flows have one total pressure with {' or with '.join(found)}" if found else ""


def _warm_enough(network: Network, values: Mapping[str, Any]) -> str:
    """The burner's exit temperature from which on the gas of a recuperator is warmer than its air."""
    burner = next(c for c in network.components if isinstance(c, Burner))
    kept = burner.values["exit_temperature_K"]

    def surplus(x: float) -> float:
        burner.values["exit_temperature_K"] = x
        try:
            _run(network, values)
        except ColdGasError as error:
            return error.surplus_K
        except ValueError:
            return np.nan
        finally:
            burner.values["exit_temperature_K"] = kept
        return 1.0

    value = _bisected(surplus, kept, T_FIT[1])
    if value is None:
        return "a lower pressure_ratio of the compressors would let it"
    return f"it is as warm with {burner.name}: exit_temperature_K: {value:.0f}, or with less pressure_ratio before it"


def _feeding(network: Network, splitter: Splitter) -> Compressor | None:
    """The compressor nearest before the splitter."""
    before = network.components[: network.components.index(splitter)]
    return next((c for c in reversed(before) if isinstance(c, Compressor)), None)


def _ratio_at(
    network: Network, values: Mapping[str, Any], mixer: Mixer, component: Component, key: str, x: float
) -> float:
    """Bypass over core total pressure at the mixer with another value of one key; NaN where nothing can be sized."""
    kept = component.values[key]
    component.values[key] = x
    try:
        _run(network, values)
        return mixer.design_ratio
    except PressureMismatchError as error:
        return error.ratio
    except ValueError as error:
        # the core has nothing left: its pressure is too low for any mixer behind it
        return np.inf if mixer.name not in str(error) else np.nan
    finally:
        component.values[key] = kept


def _bisected(surplus: Callable[[float], float], low: float, high: float) -> float | None:
    """Where a rising function is zero; None where its ends have one sign."""
    if not (surplus(low) < 0.0 < surplus(high)):
        return None
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if surplus(middle) < 0.0 else (low, middle)
    return 0.5 * (low + high)
