"""What the search says of another simulator's effects once its library does not hold them: python
tests/verification/pycycle_laws.py [RECORDING …]

In `concealed_3` the efficiencies of fan, HPC and LPT fall with Reynolds number, by 1.5, 3 and 3 % per decade; here the
library is without everything that varies with Reynolds number. A law at these machines, along Reynolds number, is
right. In the other recordings what is concealed moves from record to record at random: no law is right. Prints places,
drivers and forms with their probabilities, and the slope per decade of each law over the records, beside the answer.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import pycycle_concealed as concealed
import shared_data

from enginediag_cli.drivers import REYNOLDS_INDEX
from enginediag_cli.engine.dual import value
from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.explain.answer import FORMULA, Answer, Explanation
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.unrecorded_search import hidden_search
from enginediag_cli.mismatch.laws.scan import KnownVariable, known_variables
from enginediag_cli.physics.law import Law
from enginediag_cli.physics.registry import candidate_effects

RECORDINGS = ("concealed_3", "concealed_1", "concealed_2", "concealed_4", "nominal")
TRUE_PER_DECADE = {"fan": 0.015, "hpc": 0.03, "lpt": 0.03}
"""Fall of the efficiency over a decade of Reynolds number in `concealed_3` (`x_re_a_…` of its answer)."""


def searched(engine: Engine, name: str) -> tuple[Search, Answer]:
    """The search of a recording, without effects that vary with Reynolds number."""
    given = concealed.evidence(engine, name)
    left = [e for e in candidate_effects(engine) if e.term.DRIVER != REYNOLDS_INDEX]
    search = Search(given, left, hidden_search(given))
    return search, search.run()


def slopes(explanation: Explanation, known: list[KnownVariable]) -> dict[str, float]:
    """What each law of one variable changes over a decade of that, by least squares over the records, by its place."""
    fitted = {c.name: c.value for c in explanation.coefficients}
    found = {}
    for effect in (e for o in explanation.options for e in o.hypothesis.effects):
        law = effect.term
        if isinstance(law, Law) and len(law.variables) == 1:
            x = next(k.values for k in known if k.variable.name in law.variables)
            at = {c.name: fitted[effect.parameter_name(c.name)] for c in law.COEFFICIENTS}
            f = np.asarray(value(law.expression.evaluate({next(iter(law.variables)): x, **at})))
            found[law.acts.leaf] = float(np.polyfit(np.log10(x), f, 1)[0])
    return found


def report(engine: Engine, name: str) -> str:
    search, answer = searched(engine, name)
    lines = [f"{name}: {answer.status}. {answer.reason}".rstrip()]
    if answer.status != FORMULA or answer.law is None:
        lines += [f"  {x.probability:.0%} {x.label}" for x in answer.explanations[:3]]
        return "\n".join(lines)
    told = answer.law
    lines += [f"  place {where.name} {p:.2f}" for where, p in told.places[:4]]
    for groups, p in told.drivers[:3]:
        lines.append("  driver " + " and ".join("/".join(v.name for v in g[:3]) for g in groups) + f" {p:.2f}")
    known = known_variables(search.base.found)
    for x in answer.explanations[:3]:
        lines.append(f"  {x.probability:.0%} {x.label}: fall of χ² {x.gain:.0f}, left −ln p {x.left:.1f}")
        for leaf, slope in slopes(x, known).items():
            true = TRUE_PER_DECADE.get(leaf.split(".")[0]) if name == "concealed_3" else None
            lines.append(f"    {leaf} {slope:+.4f} per decade" + (f" (truth {true:+.3f})" if true else ""))
    return "\n".join(lines)


def main() -> None:
    if not shared_data.available("pycycle_hbtf"):
        sys.exit(shared_data.reason("pycycle_hbtf"))
    with tempfile.TemporaryDirectory() as scratch:
        engine = concealed.engine(Path(scratch))
        for name in sys.argv[1:] or RECORDINGS:
            print(report(engine, name), flush=True)


if __name__ == "__main__":
    main()
