"""Results in plain words: what changed, by how much, how surely, and what these data leave open.

Parameters hold their own words. Numbers have as many digits as their uncertainty supports, and their unit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from enginediag_cli.parameters import Parameter, meanings, spelled
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.intake.agreement import RecordingMismatch
    from enginediag_cli.isolation.results import AmbiguityGroup
    from enginediag_cli.residuals.instruments import FaultInFlights, InstrumentFault


def parameter_words(known: Mapping[str, Parameter], names: Iterable[str]) -> list[str]:
    """The parameters of these names as an engineer says them; one that is not known keeps its name."""
    return [p.words for p in meanings(known, names).values()]


def maintained(kind: str, component: str) -> str:
    """Maintenance in words: "exchange turbine"; of the whole engine its kind."""
    return f"{kind} {component}".strip()


def capital(text: str) -> str:
    """With a capital at its begin."""
    return text[:1].upper() + text[1:]


def listed(items: list[str] | tuple[str, ...], last: str = "and") -> str:
    """ "a", "a and b", "a, b and c"."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} {last} {items[-1]}"


def rounded(value: float, uncertainty: float | None = None, digits: int = 3) -> str:
    """`value` to the decimals at which `uncertainty` has its leading digits (one, or two for 10–19 of them).

    Without an uncertainty, to `digits` significant digits. No exponent between 1e-4 and 1e6.
    """
    if not math.isfinite(value):
        return "unknown" if math.isnan(value) else ("infinite" if value > 0 else "-infinite")
    if uncertainty is None or not math.isfinite(uncertainty) or uncertainty <= 0:
        return _without_exponent(f"{value:.{digits}g}")
    decimals = _decimals(uncertainty)
    # adding 0 turns "-0.0" into "0.0"
    return f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}"


def _decimals(uncertainty: float) -> int:
    """Decimals that show one leading digit of `uncertainty`, or two where the first is a 1."""
    magnitude = math.floor(math.log10(uncertainty))
    leading = round(uncertainty / 10.0**magnitude, 1)
    return -magnitude + (1 if leading < 2 else 0)


def _without_exponent(text: str) -> str:
    value = float(text)
    if "e" in text and (value == 0 or 1e-4 <= abs(value) < 1e6):
        return f"{value:.0f}" if abs(value) >= 1 else f"{value:f}".rstrip("0")
    return text


def format_quantity(value: float, unit: str = "", uncertainty: float | None = None, digits: int = 3) -> str:
    """For instance "4.1 K ± 0.8 K", "2.0 % ± 0.3 %" or, without an uncertainty, "4.1 K"."""
    behind = f" {unit}" if unit else ""
    text = rounded(value, uncertainty, digits) + behind
    if uncertainty is None or not math.isfinite(uncertainty) or uncertainty <= 0:
        return text
    return f"{text} ± {rounded(uncertainty, uncertainty)}{behind}"


def probability(value: float) -> str:
    """A probability to two decimals, without ever claiming 0 or 1."""
    if math.isnan(value):
        return "unknown"
    if value > 0.995:
        return "> 0.99"
    return "< 0.01" if value < 0.005 else f"{value:.2f}"


def p_value(value: float) -> str:
    """A p-value as people quote it: "0.03", "2e-05", and "< 1e-12" where the digits mean nothing."""
    if math.isnan(value):
        return "unknown"
    if value < 1e-12:
        return "< 1e-12"
    return f"{value:.1g}" if value < 0.1 else f"{value:.2f}"


READ_WRONG = frozenset({"bias", "scale"})
"""Errors of a sensor by which it reads too high or too low."""
SURE = 0.995
"""Probability from which two decimals say no more."""
STUCK_DIGITS = 6
"""Digits of a reading that repeats itself: as many as make it found again in the file."""


def display_scale(parameter: Parameter) -> tuple[float, str]:
    """Factor and unit by which a change of this parameter is shown: a scale factor in per cent."""
    unit = parameter.shown_unit
    # an error that is added to a ratio is a ratio, no share of what is read
    added = bool(unit) or (parameter.belongs_to_instrument and parameter.quantity == "bias")
    return (1.0, unit) if added else (100.0, "%")


def change(parameter: Parameter, delta: float, half_width: float | None = None, *, chance: float | None = None) -> str:
    """The change of one parameter from nominal, for instance
    "HPC isentropic efficiency fell by 2.0 % ± 0.3 % (probability 0.97)".

    `delta` is the value minus the nominal one in the parameter's own unit: a number without unit is a scale
    factor and is written in per cent. `half_width` is half the interval, `chance` the probability that the
    parameter changed at all.
    """
    scale, unit = display_scale(parameter)
    size = format_quantity(abs(scale * delta), unit, _times(scale, half_width))
    behind = f" (probability {probability(chance)})" if chance is not None else ""
    if parameter.belongs_to_instrument and parameter.quantity in READ_WRONG:
        return f"{parameter.part} reads {size} too {'high' if delta > 0 else 'low'}{behind}"
    if parameter.belongs_to_instrument and parameter.quantity == "drift":
        return f"{parameter.part} drifts {'up' if delta > 0 else 'down'} by {size}{behind}"
    return f"{parameter.words} {'rose' if delta > 0 else 'fell'} by {size}{behind}"


def instrument_fault(fault: InstrumentFault) -> str:
    """An instrument that is stuck or scatters, "T45 sensor is stuck at 812 K from record 120 of 400", "T45 sensor
    scatters 4 times its stated noise"."""
    stuck = _fault_words(fault)
    if fault.form == "noise":
        behind = "" if fault.probability > SURE else f" (probability {probability(fault.probability)})"
        return stuck + behind
    if fault.throughout:
        return f"{stuck} in all {count(fault.records, 'record')}"
    last = fault.first + fault.last_line - fault.first_line
    if not fault.first:
        return f"{stuck} in {fault.count:,} of {count(fault.records, 'record')}, from line {fault.first_line} on"
    if last < fault.records:
        return f"{stuck} from record {fault.first:,} to {last:,} of {fault.records:,}"
    return f"{stuck} from record {fault.first:,} of {fault.records:,} on"


def instrument_in_flights(found: FaultInFlights) -> str:
    """An instrument that is stuck or scatters over flights, "T45 sensor is stuck at 812 K in 3 of 40 flights (12 to
    14)"."""
    first, last = found.first_flight or str(found.first), found.last_flight or str(found.last)
    where = first if found.flights == 1 else f"{first} to {last}"
    return f"{_fault_words(found.fault)} in {found.flights:,} of {count(found.flights_in_all, 'flight')} ({where})"


def _fault_words(fault: InstrumentFault) -> str:
    """How an instrument is wrong, without where: "T45 sensor is stuck at 812 K"."""
    part = f"{fault.quantity} {'reading' if fault.is_input else 'sensor'}"
    unit = split_column(fault.column)[1]
    if fault.form == "noise":
        by = (
            f"by {format_quantity(fault.size, unit)}" if fault.is_input else f"{fault.times:.2g} times its stated noise"
        )
        return f"{part} scatters {by}"
    return f"{part} is stuck at {format_quantity(fault.size, unit, digits=STUCK_DIGITS)}"


def _times(factor: float, value: float | None) -> float | None:
    return None if value is None else factor * value


def not_listed(ratio: float, unlisted: float) -> str:
    """Why an answer does not stand: what happened is likelier none of the suspects."""
    left = f", reduced χ² {ratio:.2g} with the best of them" if math.isfinite(ratio) else ""
    return f"something that is not among the suspects (probability {probability(unlisted)}{left}): no conclusion"


def wrong_file(found: RecordingMismatch) -> str:
    """Why an answer does not stand: the recording is likelier wrong than the engine, although that was accepted."""
    return (
        f"the recording is likelier wrong than the engine (probability {probability(found.wrong_file)}): "
        f"{found.description}; "
        "check columns, units and engine file: no conclusion"
    )


def unexplained(before: float, after: float, explained: float) -> str:
    """What an answer leaves unexplained, "reduced χ² 12 without, 1.1 with this answer: 99 % of the excess is
    explained"; empty where nothing is left to test it by."""
    if not math.isfinite(after):
        return ""
    told = (
        f"reduced χ² {before:.3g} without, {after:.3g} with this answer"
        if after != before
        else f"reduced χ² {after:.3g}"
    )
    return told if not math.isfinite(explained) else f"{told}: {100 * explained:.0f} % of the excess is explained"


def ambiguity_words(found: AmbiguityGroup, words: Callable[[Sequence[str]], Sequence[str]]) -> str:
    """A class instead of a name: "cannot tell: HPC isentropic efficiency or T3 sensor bias (together probability 0.97);
    T45 would tell". words: how names are said."""
    members = [listed(list(words(member))) for member in found.members]
    more = f", or one of {found.members_omitted} more" if found.members_omitted else ""
    beside = f" beside {listed(list(words(found.shared)))}" if found.shared else ""
    told = f"ambiguous: {listed(members, 'or')}{more}{beside} (together probability {probability(found.probability)})"
    sensors = [split_column(column)[0] for column in found.separating_sensors]
    return f"{told}; {listed(sensors, 'or')} would separate them" if sensors else told


def outside_physics(parameter: Parameter, delta: float, unlisted: float) -> str:
    """Why an answer does not stand: what would fit best is a change that is impossible."""
    what = "an instrument" if parameter.belongs_to_instrument else "a component"
    return (
        f"something that is not among the suspects (probability {probability(unlisted)}): it would take that "
        f"{change(parameter, delta)}, outside what {what} can do; check units and engine file: no conclusion"
    )


def sensor_or_component(
    sensors: Sequence[str],
    components: Sequence[str],
    of_sensors: float,
    of_components: float,
    shared: Sequence[str] = (),
) -> str:
    """An instrument and the engine as alternatives, each in words, the likelier first, for instance
    "cannot tell T3 sensor bias from HPC isentropic efficiency: 0.55 against 0.41".

    `shared`: what has changed in both explanations.
    """
    rivals = ((sensors, of_sensors), (components, of_components))
    (names, p), (others, q) = sorted(rivals, key=lambda item: -item[1])
    one, other = (listed(list(each)) for each in (names, others))
    beside = f" (beside {listed(list(shared))})" if shared else ""
    return f"{one} is indistinguishable from {other}{beside}: {probability(p)} against {probability(q)}"


def named_fault(severities: Sequence[tuple[str, float, float]], chance: float) -> str:
    """Faults of a catalogue by name with severity and half its interval, for instance
    "HPC fouling, severity 0.9 ± 0.1 (probability 0.93)"."""
    told = [f"{spelled(name)}, severity {format_quantity(value, '', half)}" for name, value, half in severities]
    return f"{listed(told, 'and')} (probability {probability(chance)})"


def further_records(where: str, records: float, odds: float, noncentrality: float) -> str:
    """How soon records of one kind would separate two hypotheses, for instance
    "12 records with T4_K for odds of 20 to 1 (non-centrality 0.51 per record)"."""
    if records == float("inf"):
        return f"records {where} would not separate them"
    needed = count(int(records), "record")
    return f"{needed} {where} for odds of {odds:g} to 1 (non-centrality {rounded(noncentrality)} per record)"


def departed(
    statistic: float,
    threshold: float,
    freedom: int,
    p: float | None = None,
    *,
    where: str = "",
    onset: str = "",
) -> str:
    """The verdict that the engine is no longer nominal, with the numbers it rests on."""
    begins = f", beginning about {onset}" if onset else ""
    return f"{_prefix(where)}departs from nominal{begins} {_evidence(statistic, threshold, freedom, p)}"


def nominal(statistic: float, threshold: float, freedom: int, p: float | None = None, *, where: str = "") -> str:
    """The verdict that nothing speaks against a nominal engine."""
    return f"{_prefix(where)}agrees with nominal {_evidence(statistic, threshold, freedom, p)}"


def no_verdict(reason: str, *, where: str = "") -> str:
    """Neither healthy nor faulty, and why."""
    return f"{_prefix(where)}no verdict: {reason}"


def count(number: int, noun: str, plural: str = "") -> str:
    """ "1 record", "1,200 records"."""
    return f"{number:,} {noun if number == 1 else plural or noun + 's'}"


def _prefix(where: str) -> str:
    return f"{where}: " if where else ""


def _evidence(statistic: float, threshold: float, freedom: int, p: float | None) -> str:
    chance = f", p {_equals(p_value(p))}" if p is not None else ""
    freedoms = count(freedom, "degree of freedom", "degrees of freedom")
    numbers = f"statistic {rounded(statistic)}, threshold {rounded(threshold)}, {freedoms}"
    return f"({numbers}{chance})"


def _equals(text: str) -> str:
    return text if text.startswith("<") else f"= {text}"
