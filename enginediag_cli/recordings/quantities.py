"""What a foreign column is, by its name: a scored grammar from words to quantity, station, engine, probe and unit.

A name is cut into words (`Eng (1) FFlow` → eng, 1, f, flow), each word means features (`itt` → temperature, between the
turbines), and the rule that explains most of the features, and leaves none that it does not know, is the quantity.
The rest (`oil`, `demand`, `vibration`) makes another quantity of it, which the program has no use for.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple

from enginediag_cli.units import UnitWord, split_unit

TEMPERATURES = ("K", "degC", "degF", "degR")
PRESSURES = ("Pa", "kPa", "bar", "psi", "mbar", "MPa", "inHg", "atm")
SPEEDS = ("kt", "m_s", "kmh")
FLOWS = ("kg_s", "kg_h", "lb_h", "lb_s", "g_s")
_POWERS = ("W", "kW", "MW", "hp", "pct")

_KINDS = {
    "T": "t temp temps temperature temperatures tmp temperatur température températures tt",
    "P": "p press pressure pressures pres prs druck pression",
    "N": "n xn rpm rotation revolutions rev drehzahl régime",
    "speed": "speed spd velocity vitesse",
    "flow": "flow flw w massflow durchfluss débit debit",
    "rate": "rate mass consumption",
    "torque": "torque trq tq tor torq drehmoment gtt couple",
    "power": "power pwr leistung puissance",
    "altitude": "altitude alt alti hoehe höhe",
    "mach": "mach mn machno xm",
    "humidity": "humidity hum humidité humidite feuchte",
    "thrust": "thrust schub poussée poussee",
    "dp": "dp deltap differential diff loss losses drop",
    "EPR": "epr",
    "BPR": "bpr",
    "date": "date datum",
    "time": "time zeit uhrzeit heure timestamp stamp",
}
_PLACES = {
    "ambient": "ambient amb outside atmospheric atm barometric barometer umgebung umgebungs ambiant ambiante "
    "atmosphérique atmospherique cell",
    "baro": "baro",
    "air": "air",
    "fuel": "fuel kraftstoff brennstoff combustible carburant",
    "gas": "gas gaz",
    "fan": "fan",
    "lpc": "lpc booster",
    "ipc": "ipc",
    "compressor": "compressor comp cmp cprsr compr verdichter compresseur",
    "hpc": "hpc",
    "burner": "burner combustor combustion comb",
    "turbine": "turbine turb turbines",
    "hpt": "hpt",
    "lpt": "lpt",
    "core": "core",
    "lp": "lp",
    "ip": "ip",
    "hp": "hp",
    "generator": "generator gen producer",
    "gg": "gg gasgen",
    "pt": "pt",
    "shaft": "shaft spool rotor",
    "propeller": "prop propeller",
    "exhaust": "exhaust exh abgas abgases échappement echappement",
    "nozzle": "nozzle",
    "interturbine": "interturbine inter interstage",
    "measured gas": "mgt",
    "in": "in inlet inl entry entrance intake einlass eintritt entrée entree",
    "out": "out outlet exit exi discharge disch dischg output dis delivery del auslass austritt",
    "filter": "filter",
    "bypass": "bypass byp",
    "ratio": "ratio",
}
_PROPERTIES = {
    "total": "total tot stagnation",
    "static": "static stat",
    "standard": "std standard",
    "relative": "relative rel",
    "calibrated": "calibrated cal computed",
    "true": "true",
    "indicated": "indicated ind",
    "electrical": "el electric electrical electrics active real",
    "net": "net",
    "gross": "gross",
    "abs": "abs absolute",
    "gauge": "gauge gage",
    "no": "no nr number num",
    "id": "id serial identifier ident",
    "dry": "dry",
    "selected": "selected sel select",
    "engine": "engine eng engines motor triebwerk",
}
_WHOLE = {
    "altitude pressure": "zp hpalt palt altp pressalt",
    "altitude geometric": "altmsl altgps gpsalt altgeo gps",
    "altitude baro": "altb altind baroalt",
    "mach whole": "ma",
    "V calibrated": "cas vcas kcas",
    "V indicated": "ias kias",
    "V true": "tas ktas vtas",
    "V air": "airspeed",
    "T ambient": "oat tamb",
    "deviation_from_ISA": "disa isadev dtisa",
    "T static air": "sat",
    "T total air": "tat rat",
    "P ambient": "pamb afpap",
    "P static air": "psa",
    "humidity relative": "rh",
    "N 1": "n1 xn1",
    "N 2": "n2 xn2x",
    "N 3": "n3",
    "N lp": "nl nlp xnl xn2",
    "N hp": "nh nhp xnh xn25",
    "N ip": "ni nip",
    "N gg": "ng ngg ngp ngen tnh",
    "N pt": "np npt tnl",
    "N fan": "nf nfan n1fan",
    "N core": "nc ncore",
    "fuel flow": "ff fflow fuelflow wf wfe wff wfuel wfm fuelrate fqg fqgas fql",
    "T exhaust": "egt tgt",
    "T turbine out": "ttxm ttx ttxd txm",
    "T interturbine": "itt",
    "T turbine in": "tit tet",
    "T compressor out": "cdt ctd",
    "P compressor out gauge?": "cpd",
    "P compressor out": "cdp pcd",
    "T compressor in": "ctim cit ctif",
    "P compressor in": "cip",
    "T in": "tinlet",
    "P static": "ps",
    "P total": "ptot",
    "T total": "ttot",
    "power electrical": "dwatt mwatt watt watts mw",
    "power": "shp hpwr",
    "torque": "etq",
    "thrust": "fn fnm",
    "thrust gross": "fg",
    "thrust net": "fnet",
    "serial": "esn enginesn engsn",
    "tail": "tail registration reg acreg tailno aircraft acid msn",
    "flight": "flight flt leg flug cycle cycles csn",
    "phase": "phase fltphase flightphase rpt mode regime",
    "utc": "utc gmt zulu",
    "local": "lcl local",
    "epoch": "epoch unix unixtime posix",
    "elapsed": "elapsed secs seconds sec",
    "offset": "utcofst",
}
_OTHER = """
    oil huile öl
    lube lub hyd hydraulic vib vibration vibe brg bearing cabin cab bleed tank qty quantity used remaining rem cmd
    command demand demanded dmd ref reference setpoint setpt sp target limit lim redline max min maximum minimum stdev
    sigma corrected corr cor margin delta deviation bias error status valid flag fault warn warning alarm spread
    nacelle nac starter start gearbox volt volts voltage amp amps current frequency freq wind ground gs gnd vertical
    vert vs radio radar ra lat latitude lon long longitude pitch roll heading hdg track flap flaps gear weight wt gw
    count cht cyl cylinder manifold map density specific sfc tsfc vane vsv igv vigv vbv csgv valve position pos angle
    accel acceleration trim avail available wheelspace ws metal blade water steam injection nox co co2 o2 emission
    emissions level cooling tra pla tla lever throttle rudder aileron elevator bus battery bat quality qual qc cond
    fsr ttrf surge stall stage row efficiency eff index idx coolant dew humid hobbs hours days age wheel brake tire
    nav com course crs waypoint wpt satellite cooled clearance case casing skin wall rack bay seal drain vent buffer
    pump servo chip debris particle acoustic dynamics spray wash anti ice icing deice ecs pack apu nr dynamic slip yaw
    aoa alpha beta message word bit offset off decay kmc kmt health theta
    sqrt reactive apparent aux auxiliary station factor hold exceed exceedance setting rating governor hrsg n2o n1k
    n2k n3k nfk nck nrf nrc n1r2 n2r25"""
"""Words that make a quantity of which the program has no use, whatever stands beside them."""
_HARMLESS = """
    mech mechanical measured physical actual act meas sensed value val reading avg average mean sensor probe channel ch
    signal sig the of at on ac recorded data rec from scada dcs pi tag pv e gasturbine gt unit degrees live
    instantaneous inst observed xmtr tx thermocouple tc rtd junction dyno dynamometer"""
"""Words that say nothing of the quantity."""

Features = frozenset[str]
SIDES = ("left", "right", "lh", "rh", "port", "stbd")
"""Words that say which engine of two."""


def _lexicon() -> dict[str, Features]:
    words: dict[str, Features] = {}
    for table in (_KINDS, _PLACES, _PROPERTIES):
        for feature, spelt in table.items():
            words.update({word: frozenset({feature}) for word in spelt.split()})
    for features, spelt in _WHOLE.items():
        words.update({word: frozenset(features.split()) for word in spelt.split()})
    words.update({word: frozenset({f"other {word}"}) for word in _OTHER.split()})
    words.update({word: frozenset() for word in (*_HARMLESS.split(), *SIDES)})
    words.update({"tt": frozenset({"T", "total"}), "mgt": frozenset({"T", "exhaust"})})
    # a power turbine or a total pressure; turbine outlet temperature or total; number or main rotor speed
    # the exit in French, or a flight
    words.update({word: frozenset({f"either {word}"}) for word in ("pt", "tot", "nr", "sortie")})
    return words


LEXICON: Mapping[str, Features] = _lexicon()
"""Word in small letters → what it means; no feature where it means nothing for the quantity."""


@dataclass(frozen=True)
class NameRule:
    """A quantity: the features that make it, those that may stand beside them, its column ({} the station), the units
    in which it is usually recorded in the order of preference, and what is to be said of it."""

    needs: Features
    target: str
    units: tuple[str, ...]
    may: Features = frozenset()
    doubt: str = ""
    rank: float = 0.0


def _rule(needs: str, target: str, units: Sequence[str], may: str = "", doubt: str = "", rank: float = 0.0) -> NameRule:
    return NameRule(frozenset(needs.split()), target, tuple(units), frozenset(may.split()), doubt, rank)


_SPEED = ("rpm", "pct")
_AREA = "total static abs air engine gas measured dry"
_TURBINE = "total static abs gas engine"
RULES: tuple[NameRule, ...] = (
    _rule("altitude", "altitude_m", ("ft", "m", "kft"), "standard abs"),
    _rule("altitude P", "altitude_m", ("ft", "m", "kft"), "standard baro abs"),
    _rule("altitude pressure", "altitude_m", ("ft", "m", "kft"), "standard P"),
    _rule("altitude baro", "altitude_m", ("ft", "m", "kft"), "P", "set to the local pressure, not to 1013 hPa", -0.6),
    _rule("altitude geometric", "altitude_m", ("ft", "m", "kft"), "", "geometric, not pressure altitude", -1.2),
    _rule("mach", "mach", ("1",), "no true indicated whole"),
    _rule("V calibrated", "cas_m_s", SPEEDS, "air speed"),
    _rule("V indicated", "cas_m_s", SPEEDS, "air speed", rank=-0.2),
    _rule("V air", "cas_m_s", SPEEDS, "speed", "indicated, calibrated or true airspeed", -0.4),
    _rule("speed air calibrated", "cas_m_s", SPEEDS),
    _rule("speed air indicated", "cas_m_s", SPEEDS),
    _rule("V air calibrated", "cas_m_s", SPEEDS),
    _rule("V air indicated", "cas_m_s", SPEEDS),
    _rule("speed air", "cas_m_s", SPEEDS, "", "indicated, calibrated or true airspeed", -0.4),
    _rule("V true", "tas_m_s", SPEEDS, "air speed"),
    _rule("speed air true", "tas_m_s", SPEEDS),
    _rule("V air true", "tas_m_s", SPEEDS),
    _rule("T ambient", "ambient_temperature_K", TEMPERATURES, "air static baro abs"),
    _rule("T static air", "ambient_temperature_K", TEMPERATURES, "ambient abs"),
    _rule("T total air", "TAT_K", TEMPERATURES, "ambient abs"),
    _rule("deviation_from_ISA", "dT_isa_K", ("K",), "T"),
    _rule("P ambient", "ambient_pressure_Pa", PRESSURES, "static abs air"),
    _rule("P baro", "ambient_pressure_Pa", PRESSURES, "abs ambient static"),
    _rule("baro", "ambient_pressure_Pa", PRESSURES, "abs", "the pressure here, or the altimeter setting", -0.5),
    _rule("P static air", "ambient_pressure_Pa", PRESSURES, "abs ambient"),
    _rule("ambient", "ambient_pressure_Pa", PRESSURES, "baro", "a pressure or a temperature", -1.5),
    _rule("humidity", "relative_humidity", ("pct", "1"), "relative ambient air"),
    _rule("fuel flow", "Wf_kg_s", FLOWS, "engine gas abs burner core rate"),
    _rule("fuel flow total", "Wf_kg_s", FLOWS, "engine gas rate", "of one engine, or of all together?", -1.0),
    _rule("fuel rate", "Wf_kg_s", FLOWS, "engine", rank=-0.3),
    _rule("air flow", "W2_kg_s", FLOWS, "engine in rate compressor total", "at which station the air flow is measured"),
    _rule("torque", "torque_Nm", ("Nm", "kNm", "lbf_ft", "pct"), "shaft out engine propeller pt turbine abs"),
    _rule("power", "power_W", _POWERS, "shaft out electrical engine generator net gross gas turbine"),
    _rule("electrical", "power_W", ("W", "kW", "MW"), "net gross", rank=-1.0),
    _rule("thrust", "Fn_N", ("N", "kN", "lbf"), "net engine"),
    _rule("thrust gross", "Fg_N", ("N", "kN", "lbf"), "engine"),
    _rule("EPR", "EPR", ("1",), "engine"),
    _rule("BPR", "BPR", ("1",), "engine"),
    _rule("P ratio engine", "EPR", ("1",), "total"),
    _rule("bypass ratio", "BPR", ("1",), "engine"),
    _rule("dp in", "dP_inlet_Pa", PRESSURES, "air static P total compressor"),
    _rule("dp filter", "dP_inlet_Pa", PRESSURES, "air in static P total", "the filter's, not the whole inlet's"),
    _rule("dp exhaust", "dP_exhaust_Pa", PRESSURES, "static P total out turbine"),
    _rule("T exhaust", "EGT_K", TEMPERATURES, "gas out total turbine abs engine"),
    _rule("T gas", "EGT_K", TEMPERATURES, "total abs engine", rank=-0.3),
    _rule("T interturbine", "ITT_K", TEMPERATURES, "turbine total gas abs engine"),
    _rule("P exhaust", "P5_Pa", PRESSURES, "gas out total static turbine abs nozzle"),
)
"""Quantities without a station; those of shafts and stations follow."""

SHAFTS = ("1", "2", "3", "lp", "ip", "hp", "gg", "pt", "fan", "core")
"""What names a shaft."""
_ALSO_CALLED = {"1": "fan lp gg gas", "2": "core hp ip pt power", "3": "core hp", "lp": "fan", "hp": "core"}
"""Words for the same shaft beside its name: `Fan speed N1`."""

_STATIONS: tuple[tuple[str, str], ...] = (
    ("2", "in|engine in|fan in|compressor in|lpc in"),
    ("21", "fan out"),
    ("24", "lpc out|ipc out"),
    ("25", "hpc in|core in|hp compressor in"),
    ("3", "compressor out|hpc out|burner in|core out|hp compressor out"),
    ("4", "burner out|turbine in|hpt in|hp turbine in|core turbine in"),
    ("45", "hpt out|lpt in|pt in|generator out|gg out|power turbine in|hp turbine out|lp turbine in|fan turbine in"),
    ("5", "turbine out|lpt out|pt out|nozzle in|power turbine out|lp turbine out|fan turbine out"),
)
"""ARP755 station → the words that name it."""


def _place_rules() -> Iterator[NameRule]:
    for station, places in _STATIONS:
        for place in places.split("|"):
            for kind, units in (("T", TEMPERATURES), ("P", PRESSURES)):
                # a gas compressor is one that the engine drives
                may = _TURBINE if station in ("45", "5") else _AREA if station == "4" else _AREA.replace(" gas", "")
                yield _rule(f"{kind} {place}", f"{kind}{station}_{'K' if kind == 'T' else 'Pa'}", units, may)
            yield _rule(f"P static {place}", f"Ps{station}_Pa", PRESSURES, "abs air")
    for shaft in SHAFTS:
        beside = f"shaft engine turbine compressor generator out {_ALSO_CALLED.get(shaft, '')}"
        for kind in ("N", "speed", "N speed"):
            yield _rule(f"{kind} {shaft}", f"shaft {shaft}", _SPEED, beside)
    for kind in ("N", "speed", "N speed"):
        yield _rule(f"{kind} gas generator", "shaft gg", _SPEED, "shaft turbine")
        yield _rule(f"{kind} power turbine", "shaft pt", _SPEED, "shaft out")
        yield _rule(f"{kind} turbine", "shaft any", _SPEED, "shaft gas engine generator", "which shaft", -0.5)
        yield _rule(f"{kind} propeller", "shaft pt", _SPEED, "", "the propeller's, not the power turbine's", -0.3)
        yield _rule(f"{kind} engine", "shaft any", _SPEED, "shaft", "", -0.5)
        yield _rule(f"{kind} shaft", "shaft any", _SPEED, "engine", "", -0.5)
    yield _rule("N", "shaft any", _SPEED, "", "", -0.5)
    yield _rule("N speed", "shaft any", _SPEED, "", "", -0.5)


ALL_RULES = (*RULES, *_place_rules())


@dataclass(frozen=True)
class NameMark:
    """A number or letter in a name that distinguishes engines or probes. start, end: its place in the name;
    explicit: a word such as `engine` or `left` says that it is an engine's."""

    text: str
    start: int
    end: int
    explicit: bool


@dataclass(frozen=True)
class ParsedName:
    """A column's name taken apart. features: of its words together; station: the ARP755 number, empty where none stands
    there; unknown: words that the lexicon does not hold; unit: as the name states it."""

    text: str
    features: Features
    station: str = ""
    marks: tuple[NameMark, ...] = ()
    unknown: tuple[str, ...] = ()
    unit: UnitWord | None = None


@dataclass(frozen=True)
class Meaning:
    """What a name is taken for: target (`shaft …` until all shafts of the file are known), usual units, score (features
    explained less words unknown), doubt."""

    target: str
    units: tuple[str, ...]
    score: float
    doubt: str = ""
    remarks: tuple[str, ...] = field(default=())


@dataclass(frozen=True)
class _NamePiece:
    text: str
    start: int
    end: int
    chunk: int
    kind: str
    """word, number, letter or unknown"""


LETTERS = "abcdlr"
"""Letters that number engines or probes: A to D, left and right."""


def _cuts(chunk: str) -> set[int]:
    """Where a chunk may be cut for free: between letters and digits, before a capital after a small letter, before the
    last capital of several."""
    return {m.start() for m in re.finditer(r"(?<=[a-zà-öø-ÿß])(?=[A-ZÀ-ÖØ-Þ])|(?<=[A-Z])(?=[A-Z][a-z])", chunk)} | {
        m.start() for m in re.finditer(r"(?<=\D)(?=\d)|(?<=\d)(?=\D)", chunk)
    }


@lru_cache(maxsize=4096)
def _segments(chunk: str) -> tuple[tuple[int, int, str], ...]:
    """The cheapest way to cut a chunk of letters and digits into words, numbers and letters: (start, end, kind)."""
    cuts, n = _cuts(chunk) | {len(chunk)}, len(chunk)
    nothing: tuple[tuple[int, int, str], ...] = ()
    best = [(0.0, nothing)] + [(1e9, nothing)] * n
    for i in range(n):
        base, path = best[i]
        if base >= 1e9:
            continue
        for j in range(i + 1, n + 1):
            piece = chunk[i:j]
            cost, kind = _piece_cost(piece, i, j == n)
            cost += base + (0.0 if j in cuts else 0.7) + 0.3
            if cost < best[j][0]:
                best[j] = (cost, (*path, (i, j, kind)))
    return best[n][1]


def _piece_cost(piece: str, start: int, last: bool) -> tuple[float, str]:
    lowered = piece.casefold()
    if piece.isdigit():
        return 0.0, "number"
    if re.search(r"\d", piece):
        return (0.0, "word") if lowered in LEXICON else (9.0, "unknown")
    if lowered in LEXICON and (len(piece) > 1 or start == 0 or lowered not in LETTERS):
        # letters of a kind (t, p, n, w) mean little inside a chunk
        return (0.0 if len(piece) > 2 else 0.2 if len(piece) == 2 else 0.4), "word"
    if len(piece) == 1 and lowered in LETTERS and last:
        return 0.6, "letter"
    return 1.8 + 0.1 * len(piece), "unknown"


_KKS = re.compile(r"\d{0,2}[A-Z]{3}\d{2}[A-Z]{2}\d{3}")
"""A power plant's identification of a measuring point (VGB-S-811): it says which one, the words beside it of what."""


_CHUNKS = re.compile(r"(?<![^\W_])[A-Za-z]_(?![ABCDLRabcdlr](?!\w))[A-Za-z]{1,2}\d{0,2}(?![^\W_])|[^\W_]+")
"""Letters and digits without a gap, or a symbol with its index: `p_t25`, `W_f`, but not the engine's letter."""


def _pieces(head: str, offset: int) -> list[_NamePiece]:
    found = []
    for c, chunk in enumerate(_CHUNKS.finditer(head)):
        text, gap = chunk.group().replace("_", ""), 1 if "_" in chunk.group() else 0
        if _KKS.fullmatch(text):
            continue
        for start, end, kind in _segments(text):
            at = offset + chunk.start()
            found.append(_NamePiece(text[start:end], at + start + (gap if start else 0), at + end + gap, c, kind))
    return found


def parse_name(text: str, *, single_letter_unit: bool = True, ignored: Sequence[str] = ()) -> ParsedName:
    """Take a column's name apart. single_letter_unit: whether a last C, F, K or R is a unit; ignored: words that all
    columns of the file share."""
    found = split_unit(text)
    if found and found[2] and not single_letter_unit and found[0] and text[-1:].isalpha():
        found = None
    head, unit = (found[0], found[1]) if found else (text, None)
    name = _interpret(text, _pieces(head, max(text.find(head), 0)), frozenset(ignored))
    if unit is not None and unit.dimension == "time" and name.features and not name.features & _CLOCKS:
        # `EGT_min` is a minimum
        return _interpret(text, _pieces(text, 0), frozenset(ignored))
    if unit is not None and unit.dimension == "mass flow" and not name.features & {"flow", "rate"}:
        name = replace(name, features=name.features | {"flow"})
    if unit is not None and unit.dimension == "torque":
        name = replace(name, features=name.features | {"torque"})
    if unit is not None and unit.dimension == "length" and name.features == {"hp"}:
        name = replace(name, features=LEXICON["palt"])  # the symbol of pressure altitude
    if unit is not None and unit.dimension == "rotational speed" and "N" not in name.features:
        name = replace(name, features=name.features | {"N"})
    if unit is not None and unit.dimension == "power" and "P" in name.features:
        name = replace(name, features=name.features - {"P"} | {"power"})
    return replace(name, unit=unit)


_CLOCKS = {"time", "date", "elapsed", "epoch", "utc", "local"}
_KIND_LETTERS = {"t", "p", "w", "tt", "pt", "ps", "temp", "press", "temperature", "pressure"}


def _interpret(text: str, pieces: Sequence[_NamePiece], ignored: Features) -> ParsedName:
    """Features, station and marks of the pieces of a name."""
    features: set[str] = set()
    marks: list[NameMark] = []
    unknown: list[str] = []
    station = ""
    k = 0
    pieces = _drop_symbol(pieces)
    while k < len(pieces):
        piece, lowered = pieces[k], pieces[k].text.casefold()
        k += 1
        if lowered in ignored and piece.kind != "number":
            continue
        if piece.kind in ("number", "letter") or lowered in SIDES:
            marks.append(NameMark(piece.text, piece.start, piece.end, lowered in SIDES))
        elif (group := _read_group(piece, pieces[k : k + 2], station)) is not None:
            features |= group.features
            marks += group.marks
            station = group.station or station
            k += group.taken
        elif piece.kind == "word":
            features |= LEXICON[lowered]
        else:
            unknown.append(piece.text)
    _resolve_abbreviations(features)
    if not features and not unknown and [m.text.casefold() for m in marks] == ["rh"]:
        features, marks = {"humidity", "relative"}, []  # not the right-hand engine's
    return ParsedName(text, frozenset(features), station, tuple(marks), tuple(unknown))


_ENGINE_WORDS = ("eng", "engine", "e", "engines", "ac", "gt", "unit", "motor")
"""Words that a number or letter of an engine follows."""


class _PieceGroup(NamedTuple):
    """What a piece means together with those that follow it, of which `taken` belong to it."""

    taken: int
    features: Features = frozenset()
    marks: tuple[NameMark, ...] = ()
    station: str = ""


def _read_group(piece: _NamePiece, following: Sequence[_NamePiece], station: str) -> _PieceGroup | None:
    """A word with its number: an engine, a shaft's speed, a station; None where the piece is read by itself.
    station: the name's so far."""
    lowered, after = piece.text.casefold(), following[0] if following else None
    if after is None:
        return None
    if lowered in _ENGINE_WORDS and _is_mark(piece, after):
        return _PieceGroup(1, marks=(NameMark(after.text, after.start, after.end, lowered != "unit"),))
    if after.kind != "number":
        return None
    is_joined = after.chunk == piece.chunk
    if lowered == "n" and is_joined:
        mark = (NameMark(after.text[1], after.start + 1, after.end, False),) if len(after.text) == 2 else ()
        return _PieceGroup(1, frozenset({"N", after.text[0]}), mark)
    if station:
        is_ratio = lowered in ("t", "p") and is_joined  # `T3/T2`, `P3-P2`
        return _PieceGroup(1, frozenset({"other station"})) if is_ratio else None
    if lowered not in _KIND_LETTERS:
        return None
    if len(lowered) > 2 and not is_joined:
        return _PieceGroup(0, LEXICON[lowered])
    number, more = _station(after, following[1:])
    kind = "T" if lowered[0] == "t" else "P" if lowered[0] == "p" else "flow"
    state = {"static"} if lowered == "ps" else {"total"} if lowered in ("pt", "tt") else set()
    return _PieceGroup(1 + more, frozenset({kind, *state}), station=number)


def _resolve_abbreviations(features: set[str]) -> None:
    """Abbreviations of two meanings, by the words beside them."""
    if "either pt" in features:
        features |= {"pt"} if features & {"T", "N", "speed", "P", "in", "out"} else {"P", "total"}
    if "either tot" in features:
        features |= {"total"} if features & {"T", "P", "air", "flow", "fuel"} else {"T", "exhaust"}
    if "either nr" in features:
        features |= {"no"} if features - {"either nr"} else {"other rotor"}
    if "either sortie" in features:
        features |= {"out"} if features & _PLACES.keys() else {"flight"}
    features -= {"either pt", "either tot", "either nr", "either sortie"}


def _drop_symbol(pieces: Sequence[_NamePiece]) -> Sequence[_NamePiece]:
    """The pieces without a last letter that is the symbol of what the words name: `Thrust T`, `Fuel Flow f`."""
    if len(pieces) < 2 or len(pieces[-1].text) > 1 or pieces[-1].text.casefold() not in "tpnwfmq":
        return pieces
    kinds = [p for p in pieces[:-1] if len(p.text) > 2 and LEXICON.get(p.text.casefold(), frozenset()) & _KINDS.keys()]
    return pieces[:-1] if kinds and pieces[-1].chunk != pieces[-2].chunk else pieces


def _is_mark(word: _NamePiece, after: _NamePiece) -> bool:
    """Whether a number or letter behind `eng` numbers an engine: `E1`, `Eng (2)`, `ENG_L`; `e 1` is none."""
    if word.text.casefold() == "e" and after.chunk != word.chunk:
        return False
    return (after.kind == "number" and len(after.text) == 1) or (
        len(after.text) == 1 and after.text.casefold() in LETTERS
    )


def _station(number: _NamePiece, following: Sequence[_NamePiece]) -> tuple[str, int]:
    """The ARP755 station of a number behind T or P, and how many pieces it takes: 30 → 3, 490 → 49, `2.5` → 25."""
    digits, taken = number.text, 0
    if len(digits) == 1 and following and following[0].kind == "number" and following[0].start == number.end + 1:
        if following[0].text in ("5",):
            digits, taken = digits + following[0].text, 1
    if len(digits) >= 2 and digits.endswith("0") and digits[0] != "0":
        digits = digits[:-1]
    return digits, taken


_KIND_OF_STATION = {"T": ("T{}_K", TEMPERATURES), "P": ("P{}_Pa", PRESSURES), "flow": ("W{}_kg_s", FLOWS)}
_LAST_STATION = 89
"""Stations behind 8, the nozzle's throat, that ARP755 numbers: 9 is written as one digit."""
_BESIDE_A_STATION = frozenset(
    "total static abs gas air in out compressor hpc lpc fan turbine hpt lpt pt burner nozzle exhaust engine core "
    "interturbine fuel ambient gauge generator power gg dry ip hp lp ipc".split()
)
"""Words that describe a station which a number names as well."""


def interpret_name(name: ParsedName) -> Meaning | None:
    """The quantity of a name, or None where the words make none that the program has a use for."""
    features = name.features - {"abs", "gauge", "gauge?"} | ({"abs"} if "abs" in name.features else frozenset())
    if "selected" in features:
        if features & {"altitude", "mach", "V", "air"}:
            return None  # what the autopilot is set to
        features -= {"selected"}
    lost = 0.5 * len(name.unknown)
    remarks = tuple(f"{word!r} in the name is not understood" for word in name.unknown)
    if name.station:
        kinds = [kind for kind in _KIND_OF_STATION if kind in features]
        extra = features - set(kinds) - _BESIDE_A_STATION
        if len(kinds) != 1 or extra or len(name.station) > 3 or int(name.station[:2]) > _LAST_STATION:
            return None
        form, units = _KIND_OF_STATION[kinds[0]]
        if kinds[0] == "P" and "static" in features:
            form = "Ps{}_Pa"
        if name.station == "0" and kinds[0] != "flow":
            target = "ambient_temperature_K" if kinds[0] == "T" else "ambient_pressure_Pa"
        else:
            target = form.format(name.station)
        by_words = _match_words(features, lost, remarks)
        if by_words is not None and _another_station(by_words.target, name.station):
            # ISO 2314 and others count otherwise: 2 behind the compressor, 3 before the turbine
            return replace(by_words, doubt=f"station {name.station} of another numbering than ARP755")
        return Meaning(target, units, 2.0 - lost, "", remarks)
    return _match_words(features, lost, remarks)


def _another_station(target: str, station: str) -> bool:
    """Whether a target's station is of another part of the engine; 1 and 2 are both before the compressor."""
    found = re.match(r"[TP]s?(\d)", target)
    return found is not None and found[1].replace("1", "2") != station[0].replace("1", "2")


def _match_words(features: Features, lost: float, remarks: tuple[str, ...]) -> Meaning | None:
    """The quantity of the rule that explains most of the features."""
    best: Meaning | None = None
    for rule in ALL_RULES:
        if rule.needs <= features and features - rule.needs <= rule.may:
            score = len(rule.needs) + rule.rank - lost + 0.1 * len(features & rule.may)
            if best is None or score > best.score:
                best = Meaning(rule.target, rule.units, score, rule.doubt, remarks)
    return best if best is None or best.score > 0.4 else None
