"""Stages are told to whoever listens, and to nobody by default."""

from __future__ import annotations

from enginediag_cli.progress import Stage, each, listening, stage
from enginediag_cli.report.messages import EVIDENCE_S, ProgressLine, stage_words


class Heard:
    def __init__(self) -> None:
        self.events: list[tuple[str, str, int]] = []

    def on_start(self, stage: Stage) -> None:
        self.events.append(("begun", stage.what, stage.done))

    def on_step(self, stage: Stage) -> None:
        self.events.append(("stepped", stage.what, stage.done))

    def on_end(self, stage: Stage) -> None:
        self.events.append(("ended", stage.what, stage.done))

    def on_file(self, action: str, path: str) -> None:
        self.events.append((action, path, 0))

    def wipe(self) -> None:
        pass


class Terminal:
    def __init__(self) -> None:
        self.text = ""

    def write(self, text: str) -> int:
        self.text += text
        return len(text)

    def flush(self) -> None:
        pass


def test_without_a_listener_nothing_happens():
    with stage("a", 3) as step:
        step(1)
    assert list(each([1, 2], "b")) == [1, 2]


def test_stages_lie_in_each_other_and_end_when_left_early():
    heard = Heard()
    with listening(heard):
        for _ in each([1, 2, 3], "outer", 3):
            with stage("inner"):
                break
    assert [(event, what) for event, what, _ in heard.events] == [
        ("begun", "outer"),
        ("begun", "inner"),
        ("ended", "inner"),
        ("ended", "outer"),
    ]


def test_steps_count_what_is_finished():
    heard = Heard()
    with listening(heard):
        list(each(["ab", "c"], "letters", size=len))
    assert [done for event, _, done in heard.events if event == "stepped"] == [2, 3]


def test_a_listener_hears_only_what_is_inside():
    heard = Heard()
    with listening(heard):
        pass
    list(each([1], "a"))
    assert heard.events == []


def test_time_left_is_said_only_with_evidence():
    assert stage_words(Stage("refits", 8, 0), 100.0) == "refits …"
    assert stage_words(Stage("refits", 8, 4), EVIDENCE_S / 2) == "refits  4 of 8"
    assert stage_words(Stage("refits", 8, 1), 100.0) == "refits  1 of 8"
    assert stage_words(Stage("refits", 1000, 10), 100.0) == "refits  10 of 1000"
    assert stage_words(Stage("refits", 8, 4), 10.0) == "refits  4 of 8, about 10 s left"
    assert stage_words(Stage("records", None, 3000), 10.0) == "records  3000, 300 a second"


def test_the_line_is_renewed_seldom_and_wiped_at_the_end():
    terminal, now = Terminal(), [0.0]
    line = ProgressLine(terminal, lambda: now[0])  # type: ignore[arg-type]
    with listening(line):
        for _ in each(range(1000), "a\x1bb", 1000):
            now[0] += 0.001
    assert 5 < terminal.text.count("\r") < 30
    assert "\x1b" not in terminal.text
    assert terminal.text.endswith("\r")
    assert terminal.text.rsplit("\r", 2)[1].strip() == ""
