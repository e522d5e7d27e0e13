"""What would flip an answer: as small as said, and seen in recordings that carry the error."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_engine import climb, recorded, write_known
from score_makers import linear_score, sensitivities

from enginediag_cli.intake.loader import RecordingLoader
from enginediag_cli.intake.selection import RecordingSource, open_baseline, required_columns
from enginediag_cli.isolation.diagnosis import DiagnosisOptions, component_posterior, median_model
from enginediag_cli.isolation.posterior import (
    SetInference,
    least_relevant_change,
    log_negligible_probability,
    set_posterior,
)
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.isolation.sensitivity_analysis import (
    SensitivityAnalysis,
    component_sensitivity,
    parameter_sensitivity,
    single_errors,
)
from enginediag_cli.isolation.windows import WindowIsolation
from enginediag_cli.parameters import Parameter
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv
from enginediag_cli.report.tables.isolation import flip_cells, flips_sentence
from enginediag_cli.residuals.files import WindowReader
from enginediag_cli.residuals.long_windows import RecentRecords
from enginediag_cli.residuals.monitor import build_monitor

ENGINE = Path(__file__).parents[2] / "configs" / "turbofan.yaml"
PRIOR = SetPrior()


def described(p: int, instruments: int) -> dict[str, Parameter]:
    """Parameters p0 …: efficiencies and flows of machines in turn, the last ones errors of instruments."""
    found = {}
    for i in range(p):
        health = i < p - instruments
        family, quantity = ("health", ("efficiency", "flow_capacity")[i % 2]) if health else ("sensor", "bias")
        component = f"machine{i // 2}" if health else f"sensor{i}"
        wear = -1 if quantity == "efficiency" else 0
        words = Parameter(f"p{i}", family, 1.0, 0.0, 2.0, 0.02, "1" if health else "K", component=component)
        found[f"p{i}"] = replace(words, quantity=quantity, words=f"p{i}", part=component, wear=wear)
    return found


def problem(seed: int, p: int = 8, instruments: int = 3):
    """A score with a change of p0, its posterior, and the single errors of its parameters."""
    rng = np.random.default_rng(seed)
    change = np.zeros(p)
    change[0] = -0.004
    score = replace(linear_score(rng, sensitivities(rng, p=p), change), meaning=described(p, instruments))
    return score, SetInference(score, set_posterior(score, PRIOR), PRIOR), single_errors(score, {}, {}, {})


@pytest.mark.parametrize("seed", range(6))
def test_no_smaller_error_changes_the_first_set_and_one_a_little_larger_does(seed: int) -> None:
    score, belief, errors = problem(seed)
    first = belief.posterior.names(0)
    found = [f for f in parameter_sensitivity(belief, errors).changes if f.error]
    assert found
    for flip in found:
        d = np.zeros(len(score.parameters))
        d[flip.error.position] = flip.error.scale

        def leads(a: float, d: np.ndarray = d) -> tuple[tuple[str, ...], set[str]]:
            """The set that leads, and what of it matters beside the answer."""
            moved = replace(score, b=score.b + a * (score.information @ d))
            posterior = set_posterior(moved, PRIOR)
            names, mask = posterior.names(0), posterior.masks[:1]
            beside = [n for n in names if n not in first]
            (log,) = log_negligible_probability(moved, mask, PRIOR, {})
            small = set(first) <= set(names) and log[score.indices(beside)].sum() > np.log(0.5)
            return names, set(first) if small else set(names)

        def others(names: set[str], flip=flip) -> set[str]:
            return names - ({flip.name} if flip.kind != "map" else set())

        assert leads(1.002 * flip.size)[0] == flip.conclusion
        for share in (0.998, 0.7, 0.3, -0.3, -0.7, -0.998):
            assert others(leads(share * flip.size)[1]) == others(set(first))


@pytest.mark.parametrize("seed", range(3))
def test_the_same_holds_of_components(seed: int) -> None:
    score, _, errors = problem(seed)

    def named(a: float, flip) -> tuple[str, ...]:
        d = np.zeros(len(score.parameters))
        d[flip.error.position] = flip.error.scale
        moved = replace(score, b=score.b + a * (score.information @ d))
        components, sets, probabilities, _ = component_posterior(moved, PRIOR)
        chosen = sets[median_model(sets, probabilities)]
        return tuple(c for c, member in zip(components, chosen, strict=True) if member)

    found = [f for f in component_sensitivity(score, PRIOR, errors).changes if f.error]
    assert found
    for flip in found:
        if abs(flip.size * flip.error.scale) > 0.1:
            continue  # as large as what a component can do, whose cut laws are followed approximately
        own = score.described[flip.error.position].component if flip.kind != "map" else ""
        assert named(1.01 * flip.size, flip) == flip.conclusion
        assert {*named(0.99 * flip.size, flip)} - {own} == {*named(0.0, flip)} - {own}


def test_an_error_that_is_named_itself_flips_nothing() -> None:
    """An instrument that nothing imitates: however wrong it is, it alone joins the answer."""
    score, _, _ = problem(0)
    alone = score.information.copy()
    alone[-1, :-1] = alone[:-1, -1] = 0.0
    score = replace(score, information=alone)
    belief = SetInference(score, set_posterior(score, PRIOR), PRIOR)
    found = parameter_sensitivity(belief, single_errors(score, {}, {}, {}))
    assert score.parameters[-1] not in [flip.name for flip in found.changes]


def test_where_nothing_flips_the_answer_it_is_said_so() -> None:
    told = flips_sentence(SensitivityAnalysis((), ("hpc.efficiency",), 24), lambda names: list(names))
    assert told == (
        "no single error of a map, a sensor or an input would change the name within 20 times what is stated of it "
        "(24 tried)"
    )


@pytest.fixture(scope="module")
def monitor(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flips")
    engine = load_engine(ENGINE)
    write_known(engine, ENGINE, climb(engine, 50), folder / "nominal.yaml")
    return build_monitor(open_baseline(str(folder / "nominal.yaml")), sensors=True)


def answer(monitor, path: Path, wrong: dict[tuple[str, str], float], health: dict[str, float]):
    """What `isolate` answers of a recording with a worn HPC that reads wrong: column and form of the error → size."""
    engine = load_engine(ENGINE)
    inputs = climb(engine, 50)
    table = recorded(engine, inputs, {"hpc.efficiency": 0.99, **health}, np.random.default_rng(3))
    for (column, form), size in wrong.items():
        table[column] = table[column] * (1 + size) if form == "scale" else table[column] + size
    write_csv(path, [Recording(table)])
    kept = RecentRecords(monitor, short_windows=False)
    files = WindowReader(
        RecordingLoader(RecordingSource((str(path),)), required_columns(monitor.engine, monitor.sensors)), monitor
    )
    isolating = WindowIsolation(
        files,
        DiagnosisOptions(),
        0.01,
        kept_records=kept,
        wants_sensitivity=lambda number, named: not (wrong or health),
    )
    (found,) = isolating.windows()
    return found


def test_a_recording_that_carries_the_error_is_named_otherwise_and_one_with_a_little_less_is_not(monitor, tmp_path):
    """Through the whole nonlinear path; the sizes come from the model linear at the estimate: to a fifth."""
    found = answer(monitor, tmp_path / "plain.csv", {}, {})
    first = set(found.diagnosis.result.isolated)
    assert first == {"hpc.efficiency"}
    flips = {flip.name: flip for flip in found.sensitivity.changes if flip.error}
    assert {flip.kind for flip in flips.values()} == {"map", "sensor", "input"}
    nearest = {flip.kind: flip for flip in reversed(found.sensitivity.changes) if flip.error}
    for kind, flip in nearest.items():
        for share, changed in ((0.8, False), (1.25, True)):
            a = share * flip.size * flip.error.scale
            health = {flip.name: 1.0 + a - (0.01 if flip.name == "hpc.efficiency" else 0.0)} if kind == "map" else {}
            instrument, form = flip.name.rsplit(".", 1)
            wrong = {} if kind == "map" else {(flip.error.column, form): a}
            now = answer(monitor, tmp_path / f"{kind}{share}.csv", wrong, health)
            score = now.diagnosis.score
            matters = dict(
                zip(score.parameters, least_relevant_change(score.described, score.prior_sigma), strict=True)
            )
            sizes = {c.parameter: abs(c.change) for c in now.diagnosis.result.sizes}
            left = {n for n in now.diagnosis.result.isolated if n in first or sizes[n] > matters[n]}
            left = {n for n in left if kind == "map" or n.rsplit(".", 1)[0] != instrument}
            assert (left != first) == changed, (flip, share)
    cells = flip_cells(found.sensitivity, lambda names: list(names))["flips"]
    assert [cell["times"] for cell in cells] == sorted(cell["times"] for cell in cells)
