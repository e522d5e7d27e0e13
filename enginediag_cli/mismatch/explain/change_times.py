"""When what switches has changed: records that the gate left out, read only once something is known to switch."""

from __future__ import annotations

from enginediag_cli.intake.loader import RecordingLoader, load_ungated_flights
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis, Nuisance
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding
from enginediag_cli.mismatch.unrecorded.switched import states_of, switched_parameters, switched_trials
from enginediag_cli.mismatch.unrecorded.timed import timed

MOST_FILES = 8
"""Files that are read again at most, beside those in which something changes: stretches of a known state are enough."""


def with_times(
    finding: HiddenFinding,
    refitted: list[HypothesisFit],
    base: IdentifiedHypothesis,
    along: Nuisance,
    intake: RecordingLoader,
) -> HiddenFinding:
    """The finding with its changes timed by unsteady records; as it is where there are none. `refitted`: listed effects
    at its states, best first; without one the place itself is refitted at them."""
    if not (finding.is_switch and finding.switches):
        return finding
    flights = base.evidence.flights
    changing = {s.flight for s in finding.switches}
    own = {f.file for f in flights if f.label in changing}
    others = [f for f in dict.fromkeys(f.file for f in flights) if f not in own]
    raw = {
        (w.recording.label, w.engine): w.recording.columns
        for w in load_ungated_flights(intake, own | set(others[:MOST_FILES]))
    }
    if not raw:
        return finding
    best = refitted[0].found if refitted else _of_place(finding, base, along)
    return timed(finding, best, base.evidence, raw) if best is not None else finding


def _of_place(finding: HiddenFinding, base: IdentifiedHypothesis, along: Nuisance) -> IdentifiedHypothesis | None:
    """The fit with the place, as a parameter of the engine, in the finding's states; None where it is none, or did not
    converge."""
    place = finding.location
    if place.through is not None:
        return None
    option = switched_parameters(place.name, place.component, (place.parameter,), base)
    trial = switched_trials([option], states_of(finding, base.evidence), base, along)[0]
    return trial.found if trial.converged else None
