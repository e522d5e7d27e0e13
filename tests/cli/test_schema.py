"""`schema`: the kinds of YAML file, and the JSON schema of each."""

from __future__ import annotations

import json

from enginediag_cli.config.validate import FILE_KINDS
from enginediag_cli.report.tables import OUTPUTS


def test_without_a_kind_all_kinds_are_listed(run):
    ended = run("schema")
    assert ended.exit_code == 0
    outputs = [f"output/{name}" for name in OUTPUTS]
    assert [line.split()[0] for line in ended.stdout.splitlines()] == [*FILE_KINDS, *outputs]


def test_the_schema_of_a_kind_is_json_on_standard_output(run):
    ended = run("schema", "faults")
    assert ended.exit_code == 0
    assert ended.stderr == ""
    schema = json.loads(ended.stdout)
    assert schema["$schema"] == "http://json-schema.org/draft-07/schema#"
    assert schema["properties"]["kind"]["enum"] == ["faults"]


def test_an_unknown_kind_gets_a_near_match(run):
    ended = run("schema", "fault")
    assert ended.exit_code == 2
    assert "no kind of file 'fault'; did you mean 'faults'?" in ended.stderr
