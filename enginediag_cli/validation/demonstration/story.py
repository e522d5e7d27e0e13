"""The demonstration in plain words: each step's result, and at the end what was found beside what was put in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from enginediag_cli.error_model.modelled import FAMILY
from enginediag_cli.error_model.points import POINT_FAMILY
from enginediag_cli.identification.nominal import Nominal
from enginediag_cli.report.sentences import change, departed, listed, no_verdict, nominal
from enginediag_cli.units import split_column
from enginediag_cli.validation.demonstration.flights import Flight, Size
from enginediag_cli.validation.demonstration.script import Case


def identified(found: Nominal, noise_put_in: Mapping[str, float]) -> Iterator[str]:
    """How many parameters were found, and how near the noise is to that of the simulated sensors."""
    own = [
        e for e in found.estimates if e.family not in (FAMILY, POINT_FAMILY)
    ]  # amounts of map error are no parameters of the engine
    count = {status: sum(e.status == status for e in own) for status in ("identified", "weak", "at prior")}
    yield (
        f"{count['identified']} parameters are known well from these flights, {count['weak']} a little; "
        f"{count['at prior']} stay at what was assumed"
    )
    off = {c: found.sigma[c] / noise_put_in[c] - 1 for c in found.sensors}
    worst = max(off, key=lambda c: abs(off[c]))
    yield (
        f"noise of {len(off)} sensors found, all within {100 * abs(off[worst]):.1f} % of what was put in "
        f"(farthest: {split_column(worst)[0]})"
    )


def verdict(flight: Flight) -> str:
    """What `detect` said about one flight, with the numbers that the verdict rests on."""
    row, where = flight.detection, f"flight {flight.name}"
    if flight.verdict == "no verdict":
        return no_verdict(flight.reason, where=where)
    say = departed if flight.verdict == "fault" else nominal
    return say(row["statistic"], row["threshold"], row["dof"], row["p_value"], where=where)


def isolated(flight: Flight) -> str:
    """What `isolate` named in one flight, and what it could not exclude."""
    if flight.isolated is None:
        return no_verdict(flight.reason or "nothing could be isolated", where=f"flight {flight.name}")
    told = [_change(size) for size in flight.isolated.values()]
    rival = f" [next best: {flight.rivals[0]}]" if flight.rivals else ""
    return f"flight {flight.name}: {'; '.join(told) or 'no change that matters'}{rival}"


def _change(size: Size) -> str:
    return change(size.parameter, size.change, (size.upper - size.lower) / 2, chance=size.inclusion)


def comparison(case: Case, flights: Sequence[Flight]) -> Iterator[str]:
    """What was put into the flights of a case beside what was found, then everything that was missed or wrong."""
    wrong = [flight for flight in flights if flight.put_in]
    clean = [flight for flight in flights if not flight.put_in]
    yield f"{case.title[0].upper()}{case.title[1:]}"
    if clean:
        healthy = sum(flight.verdict == "healthy" for flight in clean)
        yield f"  {_named(clean)}, nothing wrong: {healthy} of {len(clean)} judged healthy"
    if wrong:
        alarms = sum(flight.verdict == "fault" for flight in wrong)
        exact = sum(flight.put_in.keys() == (flight.isolated or {}).keys() for flight in wrong)
        yield (
            f"  {_named(wrong)}, something wrong: {alarms} of {len(wrong)} detected, {exact} isolated to exactly "
            "what was put in"
        )
        yield from _last(wrong[-1])
    yield from (f"  ! {mistake}" for flight in flights for mistake in mistakes(flight))


def closing(flights: Sequence[Flight]) -> str:
    """One sentence on whether all was found."""
    wrong = [mistake for flight in flights for mistake in mistakes(flight)]
    if not wrong:
        return (
            f"All {len(flights)} flights were judged rightly, nothing else was blamed, and every true size lies "
            "inside its 95 % interval."
        )
    things = "thing was" if len(wrong) == 1 else "things were"
    return f"In {len(flights)} flights {len(wrong)} {things} missed or wrong; they are marked with ! above."


def mistakes(flight: Flight) -> Iterator[str]:
    """False alarm, missed fault, wrong or missing parameter, and true size outside its interval."""
    where = f"flight {flight.name}"
    if flight.verdict == "no verdict":
        yield f"{where} could not be judged: {flight.reason}"
    elif flight.verdict == "fault" and not flight.put_in:
        yield f"{where}: a false alarm"
    elif flight.verdict == "healthy" and flight.put_in:
        yield f"{where}: the fault was not detected"
    if flight.isolated is None:
        return
    for name, true in flight.put_in.items():
        if name not in flight.isolated:
            yield f"{where}: {true.parameter.words} was not named"
    for name, size in flight.isolated.items():
        if name not in flight.put_in:
            yield f"{where}: {size.parameter.words} was named although nothing is wrong with it"
        elif not size.lower <= flight.put_in[name].change <= size.upper:
            yield f"{where}: the true change of {size.parameter.words} lies outside its 95 % interval"


def _last(flight: Flight) -> Iterator[str]:
    """True and found changes of one flight, one above the other."""
    where = f"flight {flight.name}"
    for name, true in flight.put_in.items():
        size = (flight.isolated or {}).get(name)
        yield f"  {where}  put in: {change(true.parameter, true.change)}"
        yield f"  {' ' * len(where)}  found:  {_change(size) if size else 'nothing of the kind'}"


def _named(flights: Sequence[Flight]) -> str:
    return f"flight{'s' if len(flights) > 1 else ''} {listed([flight.name for flight in flights])}"
