"""Laws in an explainer's answer: written as JSON, and read back as effects that an engine can carry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from enginediag_cli.config.document import appended, dump
from enginediag_cli.engine.description import EngineDescription
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.errors import EngineDiagError
from enginediag_cli.mismatch.explain.answer import Answer, Explanation
from enginediag_cli.mismatch.fit.options import Option
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.laws.declared import entry_of
from enginediag_cli.physics.laws.law import Law

Entry = Mapping[str, Any]


def entries(x: Explanation) -> list[Entry]:
    """The laws among an explanation's options, as entries of an engine file, with the coefficients that were fitted."""
    known = {c.name: c.value for c in x.coefficients}
    return [entry_of(e.with_values(known)) for e in _laws(x.options)]


def law_told(a: Answer) -> dict[str, Any]:
    """What an answer says of a law: places and drivers with their probabilities, laws, the share of the excess that the
    first explains; and the share that stays unexplained by all that is named, where the answer has it."""
    found: dict[str, Any] = {"unexplained": getattr(a, "unexplained", None)}
    if a.law is None:
        return found
    known = {c.name: c.value for x in reversed(a.explanations) for c in x.coefficients}
    laws = [(law, e) for law in a.law.laws for e in _laws((law.option,))]
    return found | {
        "law": {
            "places": [
                {"location": place.name, "component": place.component, "probability": float(p)}
                for place, p in a.law.places
            ],
            "drivers": [
                {"variables": [[v.name for v in group] for group in groups], "probability": float(p)}
                for groups, p in a.law.drivers
            ],
            "laws": [
                {
                    "entry": entry_of(e.with_values(known)),
                    "probability": float(law.probability),
                    "label": law.option.label,
                }
                for law, e in laws
            ],
            "along": [[[v.name for v in group] for group in groups] for groups in a.law.along],
            "explained": a.law.explained,
            "together": float(a.law.together),
            "alike": [a.law.places[0][0].name, *(p.name for p in a.law.alike)],
        }
    }


def _laws(options: Sequence[Option]) -> list[Effect]:
    return [e for o in options for e in o.hypothesis.effects if isinstance(e.term, Law)]


@dataclass(frozen=True)
class ToldLaw:
    """A law as it was said: names of places (as `locations_of` has them) and groups of variables, likeliest first, with
    their probabilities, `along`: those of them that hold the truth together; `entries` of the laws that are said to
    act, several where one was not enough; `explained`: share of the excess; `together`: probability of the first place
    and of those that are said to be `alike`, which the first is one of."""

    places: tuple[tuple[str, float], ...]
    drivers: tuple[tuple[tuple[tuple[str, ...], ...], float], ...]
    along: tuple[tuple[tuple[str, ...], ...], ...]
    alike: tuple[str, ...]
    entries: tuple[Entry, ...]
    explained: float
    together: float

    @staticmethod
    def of(raw: Mapping[str, Any]) -> ToldLaw | None:
        """Of an answer; None where it has none."""
        law = raw.get("law")
        if not law or not law["laws"]:
            return None
        first: Mapping[str, Any] = next(iter(raw.get("explanations", ())), {})
        return ToldLaw(
            tuple((p["location"], float(p["probability"])) for p in law["places"]),
            tuple((tuple(tuple(g) for g in d["variables"]), float(d["probability"])) for d in law["drivers"]),
            tuple(tuple(tuple(g) for g in groups) for groups in law["along"]),
            tuple(law["alike"]),
            tuple(first.get("laws", ()) or [law["laws"][0]["entry"]]),
            float(law["explained"]),
            float(law["together"]),
        )


def all_built(engine: Engine, entries: Sequence[Entry]) -> tuple[Effect, ...] | None:
    """The laws of entries; None where one of them cannot be carried."""
    found = [built(engine, entry) for entry in entries]
    known = tuple(e for e in found if e is not None)
    return known if len(known) == len(found) else None


def built(engine: Engine, entry: Entry) -> Effect | None:
    """The law of an entry at this engine; None for one that the engine's file could not carry."""
    text = dump(entry, width=100).splitlines()
    lines = [("  - " if k == 0 else "    ") + line for k, line in enumerate(text)]
    try:
        described = EngineDescription.of(engine.path, engine.declared)
        with_law = replace(described, text=appended(described.text, engine.path, "physics", [lines]))
        return load_engine(with_law).effects[-1]
    except EngineDiagError:
        return None
