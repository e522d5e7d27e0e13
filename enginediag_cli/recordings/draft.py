"""A recorder drafted from a file's head, for the user to finish: what was guessed, and what is to be decided.

`make_draft` recognises columns, units, clock and engines; `draft_yaml` writes them as YAML with comments.
"""

from __future__ import annotations

import json
import os
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.recordings.header import CMAPSS_ORDER, Header, HeaderEntry, read_header
from enginediag_cli.recordings.recorder_file import (
    HELPERS,
    EngineColumns,
    advise_on_missing,
    match_exactly,
    match_to_engine,
)
from enginediag_cli.recordings.sniff import ClockColumns, SniffedTable, find_clock
from enginediag_cli.recordings.table import DELIMITERS, THOUSANDS
from enginediag_cli.recordings.unit_inference import (
    MOST_OUTSIDE,
    InferredUnit,
    UnitColumn,
    infer_units,
    likelihood_of_range,
    propose_limits,
)
from enginediag_cli.units import UnitWord, find_unit, split_column

STAND_IN_RPM = 10000.0
"""Speed or torque at 100 %, where nothing says it: a round number that shows that it is none."""
FUEL_KG_M3 = 800.0
"""Density of jet fuel at 15 °C, 775 to 840 kg/m³ by specification."""
SEA_LEVEL_PA = 101325.0
"""What a gauge reads against where the ambient pressure is not recorded (ISO 2533)."""
IMPLAUSIBLE = -4.5
"""ln likelihood of a column's median from which a stated unit is doubtful: three soft steps outside the usual range."""


@dataclass(frozen=True)
class ColumnGuess:
    """A source column taken for `target`: unit, factor and offset of its readings, value at 100 %, density of the fuel,
    limits in the target's unit; remarks: what was guessed, and how surely; doubts: what the user must decide."""

    target: str
    source: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0
    full_scale: float | None = None
    density: float | None = None
    limits: tuple[float, float] | None = None
    remarks: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    gauge_of: str = ""
    """The absolute pressure of which it is the part above ambient."""


@dataclass
class Draft:
    """What was found. columns: target → guess, sources with {prefix} where engines have their own; engines: name →
    prefix; texts: target text column → source; derived: target → rule; missing: required columns that nothing gives,
    with what may be done; unused: columns that were not recognised, or are of no use, with the reason; open: further
    decisions."""

    sniffed: SniffedTable
    header: Header
    clock: ClockColumns | None = None
    columns: dict[str, ColumnGuess] = field(default_factory=dict)
    derived: dict[str, str] = field(default_factory=dict)
    constants: dict[str, float] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    unused: dict[str, str] = field(default_factory=dict)
    open: list[str] = field(default_factory=list)

    @property
    def engines(self) -> Mapping[str, str]:
        """Engines of the file by name, and the text that stands for {prefix}."""
        return self.header.engines

    @property
    def decisions(self) -> list[str]:
        """Everything that the user must decide, a sentence each."""
        columns = [f"{g.target}: {doubt}" for g in self.columns.values() for doubt in g.doubts]
        stamps = [f"time: {self.clock.doubt}"] if self.clock and self.clock.form and self.clock.doubt else []
        return [
            *stamps,
            *columns,
            *self.open,
            *(f"{target} is missing: {advice}" for target, advice in self.missing.items()),
        ]


def make_draft(sniffed: SniffedTable, engine: EngineColumns | None = None) -> Draft:
    """Guess what the columns are; with `engine`, its inputs and sensors, and what others are computed from."""
    sniffed = _name_columns(sniffed)
    clock = find_clock(sniffed)
    if clock is not None and _is_scheme_index(sniffed, clock):
        clock = None
    header = read_header(sniffed, clock.sources if clock else ())
    result = Draft(sniffed, header, clock, open=list(header.open))
    if sniffed.long is not None:
        result.open.append("long: which tag gives the records (clock), and how long a value is held (max_age_s)")
    if sniffed.invented and header.scheme is None:
        result.open.append("the file names no columns: state them under file: names, and take them up under columns")
    if clock is not None and clock.number is not None:
        result.columns["time_s"] = _clock_column(clock)
    entries = [match_exactly(e, engine) for e in header.entries]
    known = [e for e in entries if e.meaning is not None]
    for e in entries:
        if e.meaning is None:
            result.unused[e.column] = "of no use here" if e.name.features else "not recognised"
    if result.engines:
        known = [_doubt_shared(e) for e in known]
    if engine is not None:
        known, left = match_to_engine(known, engine)
        result.unused |= {e.column: f"{e.target}: {why or 'no column of ' + engine.name}" for e, why in left}
        result.open += [f"{e.column}: {why}" for e, why in left if why]
    chosen, probes = _choose_columns(result, known)
    _convert(result, chosen, engine)
    _add_probes(result, probes, engine)
    if not result.columns:
        result.open.append("no column was recognised")
    _derive(result, engine)
    _report_rest(result, engine)
    return result


def _doubt_shared(e: HeaderEntry) -> HeaderEntry:
    """An engine's quantity that the file has once for several engines is a question; the air is the same for all."""
    if e.target in HELPERS or "{prefix}" in e.pattern:
        return e
    return replace(e, doubts=(*e.doubts, f"the file has {e.column} once for all engines: of which is it?"))


def _name_columns(sniffed: SniffedTable) -> SniffedTable:
    """A file without a header gets the names of a format that is distributed so."""
    if not sniffed.invented or len(sniffed.header) > len(CMAPSS_ORDER) or len(sniffed.header) < 5:
        return sniffed
    names = CMAPSS_ORDER[: len(sniffed.header)]
    # the first sensors of C-MAPSS: temperatures of stations 2, 24 and 30 in °R rise along the engine
    columns = [sniffed.values(c) for c in sniffed.header]
    if any(c is None for c in columns[:8]) or len(names) < 8:
        return sniffed
    middle = [float(np.nanmedian(c)) for c in columns[5:8] if c is not None]
    count = columns[1]
    if not (440 < middle[0] < 530 and middle[0] < middle[1] < 700 and 1200 < middle[2] < 1650) or count is None:
        return sniffed
    if not np.all(np.isin(np.diff(count), (1.0,)) | (np.diff(count) < 0.0)):
        return sniffed
    return replace(
        sniffed,
        header=names,
        cells=dict(zip(names, (sniffed.cells[c] for c in sniffed.header), strict=True)),
        dialect=replace(sniffed.dialect, names=names),
    )


def _is_scheme_index(sniffed: SniffedTable, clock: ClockColumns) -> bool:
    """Whether the clock is the count of cycles of a public format: C-MAPSS calls it `time` in some copies."""
    scheme = read_header(sniffed).scheme
    found = scheme.find(clock.sources[0]) if scheme else None
    return found is not None and found.text != ""


def _clock_column(clock: ClockColumns) -> ColumnGuess:
    assert clock.number is not None
    remarks = (clock.remark,) if clock.remark else ()
    doubts = (clock.doubt,) if clock.doubt else ()
    return ColumnGuess(
        "time_s", clock.sources[0], clock.number.unit, clock.number.scale, remarks=remarks, doubts=doubts
    )


# ---- one column for each target ----


def _choose_columns(result: Draft, entries: Sequence[HeaderEntry]) -> tuple[list[HeaderEntry], list[list[HeaderEntry]]]:
    """The column of each target, by the score of its name; and groups of redundant probes."""
    groups: dict[str, list[HeaderEntry]] = defaultdict(list)
    for e in entries:
        groups[e.target].append(e)
    chosen: list[HeaderEntry] = []
    probes: list[list[HeaderEntry]] = []
    for target, group in groups.items():
        if target in result.columns:
            result.unused.update({e.column: f"{target} is made by {result.columns[target].source}" for e in group})
            continue
        best = max(_rank(e) for e in group)
        first = [e for e in group if _rank(e) >= best - 1e-9]
        marked = [e for e in first if e.name.marks]
        if len(first) > 1 and len(marked) == len(first):
            probes.append(first)
        else:
            chosen.append(first[0])
            if len(first) > 1:
                others = ", ".join(repr(e.column) for e in first[1:])
                chosen[-1] = replace(first[0], doubts=(*first[0].doubts, f"{others} may as well be it"))
        taken = first if len(first) > 1 and len(marked) == len(first) else first[:1]
        for e in group:
            if e not in taken:
                result.unused[e.column] = f"{target} is taken from {taken[0].column}"
    return chosen, probes


def _rank(e: HeaderEntry) -> float:
    """Score of the name; a column in the quantity's own dimension before one in % or by volume, one with readings
    before an empty one."""
    assert e.meaning is not None
    own = split_column(e.target)[1]
    same = e.unit is None or e.unit.dimension == find_unit(own or "1").dimension
    return e.meaning.score + (0.0 if same else -0.3) - 0.05 * len(e.doubts)


# ---- units ----


def _convert(result: Draft, entries: Sequence[HeaderEntry], engine: EngineColumns | None) -> None:
    """Guess unit, conversion and limits of each column, the units that nothing states from all columns together."""
    limits = engine.limits if engine else {}
    columns = [_make_unit_column(e, limits) for e in entries]
    inferred = infer_units(columns, limits)
    for e, column, unit in zip(entries, columns, inferred, strict=True):
        _add_column(result, _guess(e, column, unit, engine))


def _add_column(result: Draft, guess: ColumnGuess) -> None:
    if guess.unit:
        result.columns[guess.target] = guess
    else:
        result.unused[guess.source] = "; ".join(guess.doubts)
        result.open += [f"{guess.source}: {doubt}" for doubt in guess.doubts]


def _make_unit_column(e: HeaderEntry, limits: Mapping[str, tuple[float, float]]) -> UnitColumn:
    """The column with its unit where it is stated; a documented unit that cannot be is not."""
    own = find_unit(split_column(e.target)[1] or "1").dimension
    if e.unit is None or e.unit.dimension != own:
        return UnitColumn(e.target, e.values)
    column = UnitColumn(e.target, e.values, e.unit.unit, e.unit.scale)
    if e.documented and likelihood_of_range(column, e.unit.unit, limits) < IMPLAUSIBLE:
        return UnitColumn(e.target, e.values)
    return column


def _guess(
    e: HeaderEntry, column: UnitColumn, inferred: InferredUnit | None, engine: EngineColumns | None
) -> ColumnGuess:
    """What a column becomes; its unit is empty where the file states one that is no unit of the quantity."""
    own = split_column(e.target)[1] or "1"
    dimension = find_unit(own).dimension
    doubts, remarks = list(e.doubts), []
    unit = e.unit if column.unit or (e.unit and not e.documented) else None
    if unit is None and e.documented and e.unit is not None:
        doubts.append(f"documented in {e.unit.unit}, which the values cannot be")
    if unit is None:
        word = inferred.unit if inferred else own
        unit = UnitWord(word)
        doubts += _unit_doubt(inferred, own)
        if inferred and inferred.certain:
            remarks.append(f"{word} from the values, {_percent(inferred.probability)}")
    elif e.documented:
        remarks.append("unit as documented")
    if e.target == "dT_isa_K" and unit.dimension == "temperature":
        # a difference of temperatures has no zero point
        unit = UnitWord("K", unit.scale * unit.definition.factor)
    if unit.unit == "pct" and dimension in ("rotational speed", "torque", "power"):
        return _full_scale(e, unit, doubts, remarks, engine)
    if unit.dimension == "volume flow" and dimension == "mass flow":
        doubts.append("density of the fuel at the meter: 800 kg/m³ is that of jet fuel at 15 °C")
        guess = ColumnGuess(e.target, e.pattern, unit.unit, unit.scale, density=FUEL_KG_M3)
        return replace(guess, doubts=tuple(doubts), remarks=tuple(remarks))
    if unit.dimension != dimension:
        return ColumnGuess(e.target, e.column, "", doubts=(f"the file says {unit.unit}, which is no {dimension}",))
    guess = ColumnGuess(e.target, e.pattern, unit.unit, unit.scale, remarks=tuple(remarks))
    stated = UnitColumn(e.target, e.values, unit.unit, unit.scale)
    if unit.gauge:
        gauge = f"{split_column(e.target)[0]}_gauge_Pa"
        return replace(guess, target=gauge, doubts=tuple(doubts), gauge_of=e.target)
    if column.unit and likelihood_of_range(stated, unit.unit) < IMPLAUSIBLE:
        median = float(np.nanmedian(stated.si_values(unit.unit)))
        doubts.append(f"in {unit.unit} its median is {median:.4g} {own}, which cannot be")
    doubts += _reference_doubt(e, unit, stated)
    if unit.dimension == "pressure" and not unit.absolute and _may_be_gauge(e.target) and not doubts:
        guess = replace(guess, remarks=(*guess.remarks, "absolute, since nothing says gauge"))
    possible = engine.limits.get(e.target) if engine and e.target in engine.sensors else None
    limits, doubt = propose_limits(e.target, stated.si_values(unit.unit), possible[1] if possible else None)
    return replace(guess, limits=limits, doubts=(*doubts, *doubt))


def _unit_doubt(inferred: InferredUnit | None, own: str) -> list[str]:
    if inferred is None:
        return [] if own == "1" else [f"unit not stated, taken for {own}"]
    if inferred.certain:
        return []
    others = ", ".join(f"{unit} {_percent(p)}" for unit, p in inferred.others)
    return [f"unit not stated: {inferred.unit} with {_percent(inferred.probability)}, or {others or 'another'}"]


def _percent(probability: float) -> str:
    return "more than 99 %" if probability > 0.99 else f"{100 * probability:.0f} %"


def _may_be_gauge(target: str) -> bool:
    """Whether a pressure is one of the engine's, which instruments may show above ambient."""
    return split_column(target)[0].lstrip("Ps").isdigit()


def _reference_doubt(e: HeaderEntry, unit: UnitWord, column: UnitColumn) -> list[str]:
    """Whether a pressure may be above ambient: what is written as psi or bar may be either."""
    if "gauge?" in e.name.features and not unit.absolute:
        return ["absolute, or above ambient (gauge), as plants mostly record it?"]
    low = float(np.nanmin(column.si_values(unit.unit)))
    if unit.dimension == "pressure" and _may_be_gauge(e.target) and low <= 0.0:
        return [f"gauge, since it goes down to {low:.4g} Pa: add the ambient pressure"]
    return []


def _full_scale(
    e: HeaderEntry, unit: UnitWord, doubts: list[str], remarks: list[str], engine: EngineColumns | None
) -> ColumnGuess:
    """A reading in % of something that only the user, or the engine file, knows."""
    own = split_column(e.target)[1]
    full = engine.design_rpm.get(e.target) if engine else None
    if full is not None:
        doubts.append(f"full_scale: 100 % taken for the engine file's design speed, {full:.8g} rpm")
    else:
        doubts.append(f"full_scale: the {own} at 100 %, here only a stand-in")
    top = full or STAND_IN_RPM
    limits = (0.0, 1.3 * top) if own == "rpm" else None
    readings = e.values[np.isfinite(e.values)]
    if limits and np.mean((readings < 0.0) | (readings > 130.0)) > MOST_OUTSIDE:
        limits = None
        doubts.append("readings in % that no shaft has: another unit, or fill values? add limits")
    guess = ColumnGuess(e.target, e.pattern, "pct", full_scale=top, limits=limits)
    return replace(guess, doubts=tuple(doubts), remarks=tuple(remarks))


# ---- probes, gauges, derived columns ----


def _add_probes(result: Draft, groups: Sequence[Sequence[HeaderEntry]], engine: EngineColumns | None) -> None:
    """Redundant probes become columns of their own, and a consensus of them the target."""
    for group in groups:
        target = group[0].target
        quantity, own = split_column(target)
        named = [replace(e, pattern=e.pattern) for e in group]
        first = len(result.columns)
        before = dict(result.columns)
        _convert(result, named[:1], engine)
        made = result.columns.pop(target, None)
        if made is None or len(result.columns) != first:
            result.columns = before
            result.unused.update({e.column: "a probe whose unit is not known" for e in group})
            continue
        columns = {}
        for k, e in enumerate(group):
            name = f"{quantity}_probe_{k + 1}" + (f"_{own}" if own else "")
            columns[name] = replace(made, target=name, source=e.pattern, doubts=made.doubts if k == 0 else ())
        result.columns.update(columns)
        readings = np.array([UnitColumn(target, e.values, made.unit, made.scale).si_values(made.unit) for e in group])
        with np.errstate(all="ignore"):
            apart = float(np.nanmedian(np.nanmax(readings, axis=0) - np.nanmin(readings, axis=0)))
        within = float(f"{max(2.0 * apart, 1e-3 * abs(float(np.nanmedian(readings)))):.2g}")
        result.derived[target] = f"rule: consensus, of: [{', '.join(columns)}], agree_within: {within:g}"
        marks = ", ".join(e.column for e in group)
        why = "" if result.engines else ", since no speed or fuel flow comes in pairs"
        result.open.append(
            f"{target}: {marks} are taken for redundant probes of one engine{why}; those that agree within {within:g} "
            f"{own} are averaged"
        )


def _derive(result: Draft, engine: EngineColumns | None) -> None:
    """Add rules for what is not recorded but follows from what is."""
    _add_ambient_to_gauges(result)
    needed = set(engine.columns) if engine else set()
    _derive_mach(result, engine is None or "mach" in needed)
    made = {*result.columns, *result.derived}
    total = next((t for t in ("TAT_K", "T2_K", "T1_K") if t in made), "")
    needs_static = not engine or needed & {"dT_isa_K", "ambient_temperature_K"}
    if "ambient_temperature_K" not in made and total and "mach" in made and needs_static:
        result.derived["ambient_temperature_K"] = f"rule: static_temperature, total: {total}"
    made = {*result.columns, *result.derived}
    needs_deviation = "dT_isa_K" not in made and (not engine or "dT_isa_K" in needed)
    if {"altitude_m", "ambient_temperature_K"} <= made and needs_deviation:
        result.derived["dT_isa_K"] = "rule: isa_deviation"
    if {"relative_humidity", "ambient_pressure_Pa", "ambient_temperature_K"} <= made:
        result.derived["humidity_kg_kg"] = "rule: humidity_ratio"
    if {"fuel_ratio_kg_s_Pa", "Ps3_Pa"} <= made and "Wf_kg_s" not in made:
        result.derived["Wf_kg_s"] = "rule: product, of: [fuel_ratio_kg_s_Pa, Ps3_Pa]"
    if "torque_Nm" in made and "power_W" not in made and (not engine or "power_W" in needed):
        _derive_power(result, made)


def _add_ambient_to_gauges(result: Draft) -> None:
    """Make absolute pressures of gauge pressures: by the recorded ambient pressure, else by an offset of one
    atmosphere."""
    derived: dict[str, str] = {}
    for target, guess in [(t, g) for t, g in result.columns.items() if g.gauge_of]:
        name = guess.gauge_of
        if "ambient_pressure_Pa" in result.columns:
            derived[name] = f"rule: sum, of: [{target}, ambient_pressure_Pa]"
        else:
            result.columns.pop(target)
            known = find_unit(guess.unit)
            offset = SEA_LEVEL_PA / known.factor / guess.scale
            doubt = "gauge, and no ambient pressure is recorded: offset is the standard atmosphere at sea level"
            result.columns[name] = replace(
                guess, target=name, offset=float(f"{offset:.6g}"), doubts=(*guess.doubts, doubt)
            )
    result.derived = {**derived, **result.derived}


def _derive_mach(result: Draft, needed: bool) -> None:
    """Add the rule of the Mach number; an airspeed from which nothing is computed leaves no doubt that matters."""
    made = {*result.columns, *result.derived}
    if "mach" not in made and needed:
        static = "ambient_temperature_K" in made
        if {"cas_m_s", "altitude_m"} <= made:
            result.derived["mach"] = "rule: mach_from_cas"
        elif "tas_m_s" in made and (static or "TAT_K" in made):
            which = "" if static else ", temperature: TAT_K, total: true"
            result.derived["mach"] = f"rule: mach_from_tas{which}"
    airspeed = result.columns.get("cas_m_s")
    if airspeed and "mach" in made and result.derived.get("mach") != "rule: mach_from_cas":
        result.columns["cas_m_s"] = replace(airspeed, doubts=(), remarks=(*airspeed.remarks, *airspeed.doubts))


def _derive_power(result: Draft, made: Collection[str]) -> None:
    """Add the rule of shaft power, the torque times a speed, where both are known in units and not in per cent."""
    speed = next((s for s in ("N2_rpm", "N1_rpm") if s in made), "")
    if speed and not any(g.full_scale for t in ("torque_Nm", speed) if (g := result.columns.get(t))):
        result.derived["power_W"] = f"rule: product, of: [torque_Nm, {speed}], factor: 0.10471975511965977"
        result.open.append(f"power_W: torque times {speed}; is that the shaft whose torque is measured?")


def _report_rest(result: Draft, engine: EngineColumns | None) -> None:
    """What the engine asks for and nothing gives, and columns that cannot be read."""
    if engine is not None:
        made = {*result.columns, *result.derived}
        named = {*engine.inputs, *engine.sensors}
        result.missing = {t: advise_on_missing(t, made, engine) for t in engine.columns if t in named and t not in made}
    result.unused.update(dict.fromkeys(result.sniffed.unusable, "without a name of its own"))
    used = {*(g.source for g in result.columns.values()), *result.header.texts.values()}
    used |= set(result.clock.sources) if result.clock else set()
    patterns = {s.replace("{prefix}", p) for s in used for p in (result.engines.values() or ("",))}
    for c in result.sniffed.header:
        if c not in patterns:
            result.unused.setdefault(c, "not recognised")


MOST_WORDS = 12
"""Unknown words in columns of numbers that are listed; a file with more is of another kind."""


def draft_yaml(found: Draft, engine: str = "") -> str:
    """The recorder as YAML text; `engine`: the engine file whose columns were sought."""
    name = os.path.basename(found.sniffed.source)
    records = max((len(cells) for cells in found.sniffed.cells.values()), default=0)
    scheme = found.header.scheme
    lines = [
        f"# Recorder drafted from the first {records} records of {_plain(name)}.",
        "# GUESSED: taken from names or values; see that it is so. DECIDE: the file leaves it open.",
        *([f"# Names as in {scheme.name}."] if scheme else []),
        "kind: recorder",
        f"description: {_quoted('recordings like ' + _plain(name))}   # DECIDE: which engine, which recorder",
    ]
    if found.decisions:
        lines += ["", "# Every command repeats these until they are removed from here:", "decide:"]
        lines += [f"  - {_quoted(_plain(text))}" for text in found.decisions]
    lines += ["", *_file(found.sniffed), *_time(found)]
    lines += ["", "columns:" if found.columns else "columns: {}   # DECIDE: no column was recognised"]
    lines += [_column_line(g) for g in found.columns.values()]
    if found.engines:
        lines += ["", "engines:   # GUESSED: speeds or fuel flows come once for each"]
        lines += [f"  {e}: {{prefix: {_quoted(p)}}}" for e, p in found.engines.items()]
    if found.header.texts:
        pairs = ", ".join(f"{target}: {_quoted(source)}" for target, source in found.header.texts.items())
        lines += ["", f"text: {{{pairs}}}   # GUESSED: what names a flight, an engine, a phase"]
    if found.derived:
        lines += ["", "derived:   # GUESSED: computed from what is recorded"]
        lines += [f"  - {{name: {target}, {rule}}}" for target, rule in found.derived.items()]
    if found.missing:
        lines += ["", f"# DECIDE: {_plain(engine)} asks for these, and no column was taken for them:"]
        lines += [f"#   {target}: {_plain(advice)}" for target, advice in found.missing.items()]
        lines += ["# An input that was not recorded may be held: `constants: {humidity_kg_kg: 0}`."]
    if found.unused:
        lines += ["", "# Not used; a text to pass through goes under `keep:`:"]
        lines += [f"#   {_plain(column)}: {_plain(why)}" for column, why in found.unused.items()]
    lines += [
        "",
        "# DECIDE: which records are steady, such as",
        "# steady: {window_s: 10, gap_s: 3, spread: {N1_rpm: 100}, dwell_s: 30, dwell: {N1_rpm: 500}}",
        "# average_s: 10",
    ]
    return "\n".join(lines) + "\n"


def _file(sniffed: SniffedTable) -> list[str]:
    dialect = sniffed.dialect
    named = {mark: word for word, mark in DELIMITERS.items()}
    lines = [
        "file:",
        f"  delimiter: {named.get(dialect.delimiter, dialect.delimiter)}",
        f"  decimal: {'comma' if dialect.decimal == ',' else 'point'}",
        f"  encoding: {dialect.encoding}" + ("   # GUESSED: it is not UTF-8" if sniffed.guessed_encoding else ""),
    ]
    if dialect.thousands:
        word = next(word for word, mark in THOUSANDS.items() if mark == dialect.thousands)
        lines.append(f"  thousands: {word}   # GUESSED")
    if dialect.names:
        lines += ["  header: none", f"  names: [{', '.join(map(_quoted, dialect.names))}]"]
        lines[-1] += "   # DECIDE: the file names no columns" if sniffed.invented and dialect.names[0] == "c1" else ""
    lines += [f"  header_line: {dialect.header_line}"] if dialect.header_line else []
    lines += ["  unit_row: true"] if dialect.unit_row else []
    words = _missing_words(sniffed)
    if words:
        lines.append(f"  missing: [{', '.join(map(_quoted, words))}]   # GUESSED: words among numbers")
    if sniffed.long:
        table = sniffed.long
        parts = [f"tag: {_quoted(table.tag)}", f"value: {_quoted(table.value)}"]
        if table.quality:
            parts += [f"quality: {_quoted(table.quality)}", f"good: [{', '.join(map(_quoted, table.good))}]"]
        lines.append(f"  long: {{{', '.join(parts)}}}   # DECIDE: clock, max_age_s: how tags are brought to one time")
    return lines


def _missing_words(sniffed: SniffedTable) -> list[str]:
    words: dict[str, int] = {}
    for column in sniffed.header:
        if sniffed.values(column) is not None:
            for word, n in sniffed.words(column).items():
                words[word] = words.get(word, 0) + n
    return sorted(words, key=lambda w: (-words[w], w))[:MOST_WORDS]


def _time(found: Draft) -> list[str]:
    clock = found.clock
    if clock is None or not clock.form:
        return []
    day = (
        "day before month"
        if clock.form.startswith("%d/")
        else "month before day"
        if clock.form.startswith("%m/")
        else ""
    )
    remark = "; ".join(x for x in (day, clock.remark) if x)
    zone = ", zone: UTC" if clock.remark == "UTC" else ""
    text = f"   # GUESSED{': ' + remark if remark else ''}" + (
        "" if zone else "; stamps without a zone are taken for UTC: zone: +01:00"
    )
    text = f"   # DECIDE: {clock.doubt}" if clock.doubt else text
    sources = ", ".join(map(_quoted, clock.sources))
    return ["", f"time: {{from: [{sources}], format: {_quoted(clock.form)}{zone}}}{text}"]


def _column_line(g: ColumnGuess) -> str:
    parts = [f"from: {_quoted(g.source)}", f"unit: {_quoted(g.unit)}"]
    parts += [f"scale: {g.scale:.10g}"] if g.scale != 1.0 else []
    parts += [f"offset: {g.offset:g}"] if g.offset else []
    parts += [f"full_scale: {g.full_scale:.8g}"] if g.full_scale is not None else []
    parts += [f"density_kg_m3: {g.density:g}"] if g.density is not None else []
    parts += [f"limits: [{_number(g.limits[0])}, {_number(g.limits[1])}]"] if g.limits else []
    text = (
        f"   # DECIDE: {'; '.join(g.doubts)}"
        if g.doubts
        else f"   # GUESSED: {'; '.join(g.remarks)}"
        if g.remarks
        else ""
    )
    return f"  {g.target}: {{{', '.join(parts)}}}{_plain(text)}"


def _number(value: float) -> str:
    """Three digits suffice for a limit; written without an exponent that YAML would read as text."""
    rounded = float(f"{value:.3g}")
    return f"{rounded:.0f}" if abs(rounded) >= 100.0 else f"{rounded:g}"


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _plain(text: str) -> str:
    """On one line and without control characters, for a comment."""
    return "".join(c if c.isprintable() else "·" for c in text)
