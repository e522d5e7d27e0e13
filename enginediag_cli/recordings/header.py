"""The columns of a foreign file read together: what all names share, which public format they follow, which of them
come once for each engine, which are probes of one quantity, and which shaft is which.

**Public formats** have names that mean something else than elsewhere, or nothing by themselves: `TAT` of a power plant
is the temperature after the turbine, `s11` of C-MAPSS a fuel flow per pressure. A scheme is taken when most of its
names are there.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.recordings.quantities import Meaning, NameMark, ParsedName, interpret_name, parse_name
from enginediag_cli.recordings.sniff import SniffedTable
from enginediag_cli.units import UnitWord, parse_unit, split_unit

LEAST = 0.6
"""Share of a scheme's names that must be in a header: files are often published without some columns."""


@dataclass(frozen=True)
class DocumentedColumn:
    """What the documentation of a format says of a column: target (empty: of no use here), unit, and what to mind."""

    target: str
    unit: str = ""
    doubt: str = ""
    text: str = ""
    """Target text column, for what names a flight or an engine."""


@dataclass(frozen=True)
class NamingScheme:
    """name: of the format; columns: names in small letters and digits only → meaning; spelt: how a name may be spelt
    otherwise, as (pattern, replacement); constants: what the format leaves out because it is always so."""

    name: str
    columns: Mapping[str, DocumentedColumn]
    spelt: tuple[tuple[str, str], ...] = ()
    constants: Mapping[str, float] | None = None

    def find(self, column: str) -> DocumentedColumn | None:
        """The meaning of a column's name, without its unit at the end."""
        bare = re.sub(r"[^a-z0-9]", "", column.casefold())
        for pattern, form in self.spelt:
            bare = re.sub(pattern, form, bare)
        return self.columns.get(bare)


def _numbered(prefix: str, entries: Sequence[DocumentedColumn]) -> dict[str, DocumentedColumn]:
    return {f"{prefix}{k + 1}": entry for k, entry in enumerate(entries)}


_NOT_USED = DocumentedColumn("")
_PHI = "the documentation says phi for this column and Ps30 for the other; by their values they are the other way round"

CMAPSS = NamingScheme(
    "C-MAPSS (NASA turbofan degradation data)",
    {
        **{
            word: DocumentedColumn("", text="engine")
            for word in ("unit", "unitnumber", "unitnr", "unitid", "engine", "id", "c1")
        },
        **{
            word: DocumentedColumn("", text="flight")
            for word in ("cycle", "cycles", "time", "timecycles", "timeincycles")
        },
        **_numbered("setting", (DocumentedColumn("altitude_m", "kft"), DocumentedColumn("mach", "1"), _NOT_USED)),
        **_numbered(
            "s",
            (
                DocumentedColumn("T2_K", "degR"),
                DocumentedColumn("T24_K", "degR"),
                DocumentedColumn("T3_K", "degR"),
                DocumentedColumn("T5_K", "degR"),
                DocumentedColumn("P2_Pa", "psi"),
                DocumentedColumn("P15_Pa", "psi"),
                DocumentedColumn("P3_Pa", "psi"),
                DocumentedColumn("N1_rpm", "rpm"),
                DocumentedColumn("N2_rpm", "rpm"),
                DocumentedColumn("EPR", "1"),
                DocumentedColumn("fuel_ratio_kg_s_Pa", "pph_psi", _PHI),
                DocumentedColumn("Ps3_Pa", "psi", _PHI),
                _NOT_USED,
                _NOT_USED,
                DocumentedColumn("BPR", "1"),
                _NOT_USED,
                _NOT_USED,
                _NOT_USED,
                _NOT_USED,
                DocumentedColumn("W31_kg_s", "lb_s"),
                DocumentedColumn("W32_kg_s", "lb_s"),
            ),
        ),
    },
    (
        (r"^(sensormeasurement|sensormeasure|sensor|sm|sens)0*(\d+)$", r"s\2"),
        (r"^(operationalsetting|opsetting|opset|os|op|setting)0*(\d)$", r"setting\2"),
    ),
)
CMAPSS_ORDER = ("unit", "cycle", "setting1", "setting2", "setting3", *(f"s{k}" for k in range(1, 22)))
"""The columns of the text files as they are distributed, without a header (Saxena and Goebel 2008, readme)."""

_N_CMAPSS_UNITS = {
    **{
        f"t{n}": (f"T{t}_K", "degR")
        for n, t in (("2", "2"), ("24", "24"), ("30", "3"), ("48", "48"), ("50", "5"), ("40", "4"))
    },
    **{
        f"p{n}": (f"P{t}_Pa", "psi")
        for n, t in (("2", "2"), ("15", "15"), ("21", "21"), ("24", "24"), ("40", "4"), ("45", "45"), ("50", "5"))
    },
    "ps30": ("Ps3_Pa", "psi"),
    "nf": ("N1_rpm", "rpm"),
    "nc": ("N2_rpm", "rpm"),
    "wf": ("Wf_kg_s", "lb_s"),
    "alt": ("altitude_m", "ft"),
    "mach": ("mach", "1"),
}
N_CMAPSS = NamingScheme(
    "N-CMAPSS (NASA turbofan data set 2)",
    {
        **{name: DocumentedColumn(*pair) for name, pair in _N_CMAPSS_UNITS.items()},
        **dict.fromkeys(("tra", "fc", "hs"), _NOT_USED),
        "unit": DocumentedColumn("", text="engine"),
        "cycle": DocumentedColumn("", text="flight"),
    },
)

UCI_POWER_PLANT = NamingScheme(
    "UCI gas turbine CO and NOx data",
    {
        "at": DocumentedColumn("ambient_temperature_K", "degC"),
        "ap": DocumentedColumn("ambient_pressure_Pa", "mbar"),
        "ah": DocumentedColumn("relative_humidity", "pct"),
        "afdp": DocumentedColumn("dP_inlet_Pa", "mbar"),
        "gtep": DocumentedColumn("dP_exhaust_Pa", "mbar"),
        "tit": DocumentedColumn("T4_K", "degC"),
        "tat": DocumentedColumn("T5_K", "degC"),
        "cdp": DocumentedColumn("P3_Pa", "bar", "documented in mbar, with values in bar"),
        "tey": DocumentedColumn("power_W", "MW"),
    },
)
NAVAL = NamingScheme(
    "UCI condition-based maintenance of naval propulsion plants",
    {
        "lp": _NOT_USED,
        "v": _NOT_USED,
        "gtt": DocumentedColumn("torque_Nm", "kNm", "documented in kN m, and published with values in kN m or in N m"),
        "gtn": DocumentedColumn("N2_rpm", "rpm"),
        "ggn": DocumentedColumn("N1_rpm", "rpm"),
        "ts": _NOT_USED,
        "tp": _NOT_USED,
        "t48": DocumentedColumn("T45_K"),
        "t1": DocumentedColumn("T2_K"),
        "t2": DocumentedColumn("T3_K"),
        "p48": DocumentedColumn("P45_Pa", "bar"),
        "p1": DocumentedColumn("P2_Pa", "bar"),
        "p2": DocumentedColumn("P3_Pa", "bar"),
        "pexh": DocumentedColumn("P5_Pa", "bar"),
        "tic": _NOT_USED,
        "mf": DocumentedColumn("Wf_kg_s", "kg_s"),
    },
    constants={"altitude_m": 0.0, "mach": 0.0},
)
SCHEMES = (CMAPSS, N_CMAPSS, UCI_POWER_PLANT, NAVAL)


def detect_scheme(names: Sequence[str]) -> NamingScheme | None:
    """The scheme whose names the columns' names (without units) mostly are, or None."""
    best, share = None, LEAST
    for scheme in SCHEMES:
        found = {id(entry): entry for name in names if (entry := scheme.find(name)) is not None}
        distinct = {name for name in names if scheme.find(name) is not None}
        meanings = {entry.target or entry.text for entry in scheme.columns.values()}
        here = {entry.target or entry.text for entry in found.values()}
        value = min(len(distinct) / max(len(meanings), 1), len(here) / len(meanings))
        if value >= share:
            best, share = scheme, value
    return best


SHARED = 0.6
"""Share of the columns that must have a word in common for it to say nothing about any of them."""
FEWEST_SHARING = 4
"""Columns that must have it: two or three may share a word that means something."""
AGREE = 0.004
"""Relative difference within which two readings are those of two channels of one engine: speeds of two engines differ
by more over a flight, two probes of one shaft by a tenth of a per cent."""


@dataclass(frozen=True)
class HeaderEntry:
    """A column of numbers and what it is taken for. values: (N,) as the file has them; unit: as the name, the unit
    row or the format's documentation states it; pattern: its name with {prefix} for the engine; doubts: to be
    decided; documented: the unit is the documentation's and not the file's."""

    column: str
    name: ParsedName
    values: np.ndarray
    meaning: Meaning | None = None
    unit: UnitWord | None = None
    pattern: str = ""
    doubts: tuple[str, ...] = ()
    documented: bool = False

    @property
    def target(self) -> str:
        """The target column, or an empty text where the name means nothing."""
        return self.meaning.target if self.meaning else ""


@dataclass
class Header:
    """entries: the columns of numbers, those of the first engine where engines have their own; engines: name → prefix;
    texts: target text column → source; open: what the user must decide; scheme: the public format; others: column of
    another engine → pattern."""

    entries: list[HeaderEntry] = field(default_factory=list)
    engines: dict[str, str] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    open: list[str] = field(default_factory=list)
    scheme: NamingScheme | None = None


def read_header(sniffed: SniffedTable, taken: Collection[str] = ()) -> Header:
    """Read the columns of a file together; taken: columns of time stamps, which are something else."""
    columns = [c for c in sniffed.header if c not in taken]
    numbers = {c: v for c in columns if (v := sniffed.values(c)) is not None}
    result = Header()
    names = _names(columns, sniffed)
    bare = {c: split_unit(c)[0] if split_unit(c) else c for c in columns}  # type: ignore[index]
    result.scheme = detect_scheme([bare[c] for c in columns])
    for c in columns:
        documented = result.scheme.find(bare[c]) if result.scheme else None
        text = documented.text if documented else "" if names[c].unit else _identity(names[c])
        if text and text not in result.texts:
            result.texts[text] = c
        elif c in numbers:
            result.entries.append(_entry(c, names[c], numbers[c], sniffed, result.scheme, bare[c]))
    _find_engines(result)
    _doubt_letters(result)
    _resolve_shafts(result)
    if result.engines:
        result.texts.pop("engine", None)
    return result


def _names(columns: Sequence[str], sniffed: SniffedTable) -> dict[str, ParsedName]:
    """Each column's name taken apart, without what most of them share."""
    start = _shared_prefix(columns)
    end = _shared_suffix([c.removeprefix(start) for c in columns])
    tails: dict[str, set[str]] = defaultdict(set)
    for c in columns:
        if re.fullmatch(r".+[ _.-][A-Za-z]", c):
            tails[c[:-2]].add(c[-1].casefold())
    single = {c: len(tails.get(c[:-2], ())) < 2 for c in columns}

    def read(ignored: Sequence[str]) -> dict[str, ParsedName]:
        return {
            c: _shift_marks(parse_name(own, single_letter_unit=single[c], ignored=ignored), c, c.find(own))
            for c in columns
            for own in (c.removeprefix(start).removesuffix(end),)
        }

    first = read(())
    words = Counter(w.casefold() for name in first.values() for w in set(name.unknown))
    ignored = [w for w, n in words.items() if n >= max(SHARED * len(columns), FEWEST_SHARING)]
    return read(ignored) if ignored else first


def _shift_marks(name: ParsedName, text: str, by: int) -> ParsedName:
    marks = tuple(replace(m, start=m.start + by, end=m.end + by) for m in name.marks)
    return replace(name, text=text, marks=marks)


def _shared_prefix(columns: Sequence[str]) -> str:
    """The longest text up to a separator, or up to three letters, with which most columns begin, if no word in it is a
    quantity's."""
    counts: Counter[str] = Counter()
    for c in columns:
        for gap in re.finditer(r"[_.:/\\|]+|\s*-\s+|\s+", c):
            if gap.end() < len(c):
                counts[c[: gap.end()]] += 1
    least = max(SHARED * len(columns), FEWEST_SHARING)
    best, most = "", _count_understood(columns, "")
    for prefix in sorted((p for p, n in counts.items() if n >= least), key=len):
        name = parse_name(prefix.strip(" _.:/\\|-"))
        understood = _count_understood(columns, prefix)
        # a prefix of words that may be a quantity's must make names understood that were not
        if understood > most or (understood == most and not name.features - {"engine"} and not name.station):
            best, most = prefix, understood
    if best:
        return best
    letters = Counter(c[:k] for c in columns for k in (1, 2, 3) if c[:k].isalpha() and len(c) > k)
    return _strip_to_words(columns, [p for p, n in letters.items() if n >= least])


def _shared_suffix(columns: Sequence[str]) -> str:
    """The text from a separator on with which most columns end, without which more of them are understood."""
    counts = Counter(c[gap.start() :] for c in columns for gap in re.finditer(r"[_.:/\\| ]+", c) if gap.start())
    least = max(SHARED * len(columns), FEWEST_SHARING)
    return _strip_to_words(columns, [s for s, n in counts.items() if n >= least], str.removesuffix)


def _strip_to_words(
    columns: Sequence[str], texts: Sequence[str], without: Callable[[str, str], str] = str.removeprefix
) -> str:
    """Of texts that most columns share, that without which most quantities are understood, at least twice as many as
    with it: one more may be chance."""
    most, best = 2 * max(_count_understood(columns, ""), 1), ""
    for text in sorted(texts, key=len):
        understood = _count_understood([without(c, text) for c in columns], "")
        if understood > most or (understood == most and not best):
            best, most = text, understood
    return best


def _count_understood(columns: Sequence[str], prefix: str) -> int:
    """How many different quantities the names mean when they are read without this prefix."""
    names = [parse_name(c.removeprefix(prefix)) for c in columns]
    return len({(m.target, name.marks[-1:] and name.marks[-1].text) for name in names if (m := interpret_name(name))})


def _identity(name: ParsedName) -> str:
    """The text column that a name is (`flight`, `engine`, `phase`), or an empty text."""
    features = name.features - {"no", "id"}
    if "phase" in features and features <= {"phase", "flight", "engine"}:
        return "phase"
    if "flight" in features and features <= {"flight"}:
        return "flight"
    if ("serial" in features or ({"engine"} == features and "id" in name.features | _words(name))) and features <= {
        "serial",
        "engine",
    }:
        return "engine"
    return ""


def _words(name: ParsedName) -> set[str]:
    return {"id"} if re.search(r"\b(id|serial|s/?n|esn)\b", name.text.replace("_", " "), re.I) else set()


def _entry(
    column: str, name: ParsedName, values: np.ndarray, sniffed: SniffedTable, scheme: NamingScheme | None, bare: str
) -> HeaderEntry:
    """A column of numbers with its meaning and the unit that is stated for it."""
    row = sniffed.units[sniffed.header.index(column)]
    unit = name.unit or parse_unit(row)
    documented = scheme.find(bare) if scheme else None
    name = replace(name, marks=()) if documented is not None else name
    if documented is not None and documented.target:
        doubts = (documented.doubt,) if documented.doubt else ()
        own = unit or (UnitWord(documented.unit) if documented.unit else None)
        meaning = Meaning(documented.target, (), 3.0)
        return HeaderEntry(column, name, values, meaning, own, column, doubts, unit is None and own is not None)
    if documented is not None:
        return HeaderEntry(column, name, values, None, unit, column)
    name = _with_kind(name, unit)
    found = interpret_name(name)
    doubts = (*((found.doubt,) if found.doubt else ()), *found.remarks) if found else ()
    return HeaderEntry(column, name, values, found, unit, column, doubts)


_KIND_BY_DIMENSION = {
    "temperature": "T",
    "pressure": "P",
    "rotational speed": "N",
    "mass flow": "flow",
    "volume flow": "flow",
    "torque": "torque",
    "power": "power",
    "force": "thrust",
}
_ALL_KINDS = {
    "T",
    "P",
    "N",
    "flow",
    "torque",
    "power",
    "thrust",
    "speed",
    "V",
    "altitude",
    "mach",
    "humidity",
    "dp",
    "EPR",
}


def _with_kind(name: ParsedName, unit: UnitWord | None) -> ParsedName:
    """A name whose words name a place alone is of the kind that its unit measures: `Ambient [kPa]`."""
    kind = _KIND_BY_DIMENSION.get(unit.dimension, "") if unit else ""
    if kind and name.features and not name.unknown and not name.features & _ALL_KINDS:
        return replace(name, features=name.features | {kind})
    return name


# ---- engines ----


LEFT, RIGHT = ("l", "lh", "left", "port"), ("r", "rh", "right", "stbd")


def _side(text: str) -> str:
    lowered = text.casefold()
    return (
        "left"
        if lowered in LEFT
        else "right"
        if lowered in RIGHT
        else lowered.upper()
        if len(lowered) == 1
        else lowered
    )


def _stems(entries: Sequence[HeaderEntry]) -> Iterator[tuple[str, NameMark, HeaderEntry]]:
    for entry in entries:
        for mark in entry.name.marks:
            yield entry.column[: mark.start] + "{prefix}" + entry.column[mark.end :], mark, entry


def _find_engines(header: Header) -> None:
    """Engines of the file: marks by which speeds or fuel flows come in pairs; only the first engine's columns stay.

    Marks of other columns alone (two temperatures, one speed) are those of probes.
    """
    known = [e for e in header.entries if e.meaning]
    stems: dict[str, dict[str, HeaderEntry]] = defaultdict(dict)
    explicit: set[str] = set()
    for stem, mark, entry in _stems(known):
        stems[stem].setdefault(mark.text, entry)
        explicit |= {stem} if mark.explicit else set()
    evidence = {s: set(by) for s, by in stems.items() if len(by) > 1 and _shows_engines(next(iter(by.values())))}
    if not evidence:
        _unpaired_marks(header, explicit, stems)
        return
    sets = Counter(frozenset(texts) for texts in evidence.values())
    texts = max(sets, key=lambda s: (any(evidence[e] == s and e in explicit for e in evidence), sets[s], -len(s)))
    if _are_channels(known, stems, evidence, texts, explicit):
        return
    ordered = sorted(texts, key=lambda t: (_side(t) != "left", t))
    header.engines = {(_side(t) if _side(t) in ("left", "right") else f"engine_{_side(t)}"): t for t in ordered}
    _keep_first_engine(header, stems, explicit, ordered)


def _shows_engines(entry: HeaderEntry) -> bool:
    return entry.target.startswith("shaft") or entry.target in ("Wf_kg_s", "N1_rpm", "N2_rpm")


def _are_channels(
    known: Sequence[HeaderEntry],
    stems: Mapping[str, Mapping[str, HeaderEntry]],
    evidence: Mapping[str, set[str]],
    texts: Collection[str],
    explicit: Collection[str],
) -> bool:
    """Whether marks are those of two channels of one engine: speeds in pairs that agree, beside one fuel flow."""
    paired = [s for s, t in evidence.items() if t == set(texts)]
    if any(s in explicit for s in paired) or any(next(iter(stems[s].values())).target == "Wf_kg_s" for s in paired):
        return False
    if not any(e.target == "Wf_kg_s" and not e.name.marks for e in known):
        return False
    for s in paired:
        one, other = list(stems[s].values())[:2]
        with np.errstate(invalid="ignore", divide="ignore"):
            apart = np.nanmedian(np.abs(one.values - other.values) / np.abs(one.values))
        if not apart < AGREE:
            return False
    return True


def _keep_first_engine(
    header: Header, stems: Mapping[str, Mapping[str, HeaderEntry]], explicit: Collection[str], texts: Sequence[str]
) -> None:
    pattern: dict[str, tuple[str, str]] = {}  # column → stem, mark
    for stem, by in sorted(stems.items(), key=lambda item: item[0] not in explicit):
        if set(by) & set(texts) and (stem in explicit or len(by) > 1 or not explicit):
            for text, entry in by.items():
                if text in texts:
                    pattern.setdefault(entry.column, (stem, text))
    complete = {stem for stem, by in stems.items() if set(texts) <= set(by)}
    kept: list[HeaderEntry] = []
    for entry in header.entries:
        stem, text = pattern.get(entry.column, ("", ""))
        spelt = [
            m for m in entry.name.marks if m.explicit and m.text not in texts and _side(m.text) in map(_side, texts)
        ]
        if spelt and not stem:
            header.open.append(
                f"{entry.column}: its engine is spelt otherwise than {' and '.join(texts)}; rename the column"
            )
        elif not stem:
            kept.append(entry)
        elif stem not in complete:
            header.open.append(f"{entry.column}: only some of the engines have this column")
        elif text == texts[0]:
            rest = tuple(m for m in entry.name.marks if m.text != text or not _starts_stem(stem, m))
            kept.append(replace(entry, pattern=stem, name=replace(entry.name, marks=rest)))
    header.entries = kept


def _starts_stem(stem: str, mark: NameMark) -> bool:
    return stem.find("{prefix}") == mark.start


def _unpaired_marks(header: Header, explicit: Collection[str], stems: Mapping[str, Mapping[str, HeaderEntry]]) -> None:
    """Marks of engines without a pair of speeds or fuel flows: one engine's where there is one, else a question."""
    texts = {_side(t) for s in explicit for t in stems[s]}
    if len(texts) > 1:
        header.open.append(
            f"columns are marked for {' and '.join(sorted(texts))}, but no speed or fuel flow comes for each of them: "
            "two engines, or probes of one?"
        )
    header.entries = [
        replace(e, name=replace(e.name, marks=tuple(m for m in e.name.marks if not m.explicit or len(texts) > 1)))
        for e in header.entries
    ]


def _doubt_letters(header: Header) -> None:
    """A letter at the end of a name that no other column has in its place may be anything: `N1R` is a corrected
    speed."""
    texts: dict[str, set[str]] = defaultdict(set)
    for stem, mark, _ in _stems(header.entries):
        texts[stem].add(mark.text)
    alone = {e.column: m.text for s, m, e in _stems(header.entries) if m.text.isalpha() and len(texts[s]) == 1}
    header.entries = [
        replace(e, doubts=(*e.doubts, f"{alone[e.column]!r} in the name is not understood"))
        if e.column in alone and not any(m.explicit for m in e.name.marks)
        else e
        for e in header.entries
    ]


# ---- shafts ----


def _resolve_shafts(header: Header) -> None:
    """`shaft lp` and the like become N1, N2, N3, by all shafts that the file has."""
    roles = {e.target.split(" ", 1)[1] for e in header.entries if e.target.startswith("shaft ")}
    numbers = shaft_numbers(roles)
    if {"gg", "fan"} == roles and any(e.target == "torque_Nm" for e in header.entries):
        numbers = {"gg": "N1", "fan": "N2"}  # `Nf` of a helicopter is its free turbine's
    entries = []
    for e in header.entries:
        role = e.target.split(" ", 1)[1] if e.target.startswith("shaft ") else ""
        if not role or e.meaning is None:
            entries.append(e)
        elif role not in numbers:
            entries.append(replace(e, meaning=None))
        else:
            doubt = (
                ()
                if e.meaning.doubt or role != "hp" or roles & {"lp", "ip", "fan", "1", "gg"}
                else ("the file has no speed of a low-pressure shaft; N2 by convention",)
            )
            entries.append(
                replace(e, meaning=replace(e.meaning, target=f"{numbers[role]}_rpm"), doubts=(*e.doubts, *doubt))
            )
    header.entries = entries


def shaft_numbers(roles: Collection[str]) -> dict[str, str]:
    """Role of a shaft → its label. The gas generator is N1 and the power turbine N2 where the gas generator has one
    shaft; else the low-pressure shaft is N1, the high-pressure one N2, or N3 above an intermediate one."""
    three = bool({"ip", "3"} & set(roles))
    numbers = {"1": "N1", "2": "N2", "3": "N3", "lp": "N1", "fan": "N1", "gg": "N1"}
    numbers |= {"ip": "N2", "hp": "N3" if three else "N2", "core": "N3" if three else "N2"}
    two_spools = bool({"hp", "core"} & set(roles)) and bool({"lp", "fan"} & set(roles))
    if "gg" in roles and {"lp", "1", "fan"} & set(roles):
        numbers["gg"] = "N2"
    if "pt" in roles:
        numbers["pt"] = "N3" if two_spools or {"1", "2"} <= set(roles) else "N2"
    if "hp" in roles and "pt" in roles and not two_spools:
        numbers["hp"] = "N1"
    if not set(roles) & {"1", "lp", "fan", "gg"}:
        numbers["any"] = "N1"
    return {role: numbers[role] for role in roles if role in numbers}
