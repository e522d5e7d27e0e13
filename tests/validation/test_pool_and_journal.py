"""Work over processes, and the journal that keeps what is finished."""

from __future__ import annotations

import os
from functools import partial

import pytest

from enginediag_cli.errors import DataError, ExitCode
from enginediag_cli.parallel import THREAD_VARIABLES, WorkerDiedError, run_tasks
from enginediag_cli.validation.trials import Journal, JournalFormat

FORM = JournalFormat(
    "run", "a journal", "the journal of something else", "--journal", lambda k, v: {k: v}, lambda x: (*x.items(),)[0]
)


def power(exponent, base):
    return base**exponent


def die_at(number, piece):
    if piece == number:
        os._exit(9)
    return piece


def threads(piece):
    return {name: os.environ.get(name) for name in THREAD_VARIABLES}


def test_every_task_comes_back_with_its_result():
    assert dict(run_tasks(partial(power, 3), range(5), 2)) == {k: k**3 for k in range(5)}
    assert list(run_tasks(partial(power, 3), (), 2)) == []


def test_processes_use_one_thread_each_and_leave_the_environment_as_it_was():
    before = threads(0)
    assert dict(run_tasks(threads, [0], 1)) == {0: dict.fromkeys(THREAD_VARIABLES, "1")}
    assert threads(0) == before


def test_a_worker_that_dies_is_an_error_with_words_not_a_traceback():
    with pytest.raises(WorkerDiedError, match="ended from outside") as caught:
        list(run_tasks(partial(die_at, 1), range(3), 1))
    assert caught.value.exit_code == ExitCode.TROUBLE


def test_a_journal_gives_back_what_was_added_and_drops_a_torn_last_line(tmp_path):
    journal = Journal(tmp_path / "j", "abc", FORM)
    assert not journal.has_lines and journal.read() == {}
    journal.add("a", 1)
    journal.add("b", 2)
    with open(journal.path, "a", encoding="utf-8") as stream:
        stream.write('{"c"')
    assert journal.read() == {"a": 1, "b": 2}
    journal.add("c", 3)
    assert Journal(journal.path, "abc", FORM).read() == {"a": 1, "b": 2, "c": 3}
    assert [p.name for p in tmp_path.iterdir()] == ["j"]


def test_a_journal_of_something_else_and_a_file_that_is_none_are_refused_and_left_alone(tmp_path):
    Journal(tmp_path / "j", "abc", FORM).write({"a": 1})
    with pytest.raises(DataError, match="something else; remove it or name another one with --journal"):
        Journal(tmp_path / "j", "xyz", FORM).read()
    (tmp_path / "binary").write_bytes(b"\xff\xfe\n\x00")
    with pytest.raises(DataError, match="not a journal"):
        Journal(tmp_path / "binary", "abc", FORM).read()
    assert (tmp_path / "binary").read_bytes() == b"\xff\xfe\n\x00"


def test_a_line_that_is_none_is_named(tmp_path):
    journal = Journal(tmp_path / "j", "abc", FORM)
    journal.write({"a": 1})
    with open(journal.path, "a", encoding="utf-8") as stream:
        stream.write("[]\n")
    with pytest.raises(DataError, match="j:3: not a line of a journal"):
        journal.read()
