from __future__ import annotations

import importlib.util
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from config_declarations import GOOD

from enginediag_cli.config import validate as kinds
from enginediag_cli.config.document import parse_document
from enginediag_cli.config.fields import KINDS, AnySection, Field, Section, json_schema
from enginediag_cli.config.validate import default_value, validate
from enginediag_cli.errors import ConfigError, Mark, Problem

DECLARED = dict(kinds.FILE_KINDS)

built: list[Path] = []


def build(path: Path) -> Any:
    built.append(path)
    if "spool: hpp" in path.read_text():
        raise ConfigError([Problem(Mark(str(path), 23, 12), "shaft 'hpp' does not exist")])


@pytest.fixture(autouse=True)
def engine_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    built.clear()
    entry = replace(kinds.FILE_KINDS["engine"], section="config_declarations:FILE", build=f"{__name__}:build")
    monkeypatch.setitem(kinds.FILE_KINDS, "engine", entry)


def written(folder: Path, text: str) -> Path:
    file = folder / "x.yaml"
    file.write_text(text)
    return file


def complaint(call: Any, *arguments: Any) -> str:
    with pytest.raises(ConfigError) as raised:
        call(*arguments)
    return str(raised.value)


def test_a_file_is_loaded_by_its_kind(tmp_path: Path) -> None:
    assert kinds.load_checked(written(tmp_path, GOOD), "engine").values["stages"] == 4


def test_a_file_of_another_kind_says_so_and_nothing_else(tmp_path: Path) -> None:
    file = written(tmp_path, "kind: faults\nfaults: []\n")
    assert complaint(kinds.load_checked, file, "engine") == (
        f"{file}:1:7: error: this is a file of kind 'faults', and one of kind 'engine' is wanted here "
        f"(give {kinds.FILE_KINDS['engine'].help})"
    )


def test_check_finds_the_kind_and_builds_what_the_file_describes(tmp_path: Path) -> None:
    file = written(tmp_path, GOOD)
    assert kinds.check_file(file).name == "engine"
    assert built == [file]


def test_check_reports_what_only_the_build_can_see(tmp_path: Path) -> None:
    file = written(tmp_path, GOOD.replace("spool: hp", "spool: hpp"))
    assert complaint(kinds.check_file, file) == f"{file}:23:12: error: shaft 'hpp' does not exist"


def test_nothing_is_built_from_a_file_that_fails_its_declarations(tmp_path: Path) -> None:
    complaint(kinds.check_file, written(tmp_path, GOOD.replace("spool", "spol")))
    assert built == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "stages: 1",
            "1:1: error: the file does not say its kind (begin it with 'kind:' and one of "
            "engine, faults, recorder, nominal, study, fleet, flight, alerts, defaults)",
        ),
        ("kind: engin", "1:7: error: unknown kind of file, the text 'engin' (did you mean 'engine'?)"),
        (
            "kind: 3",
            "1:7: error: unknown kind of file, the number 3 "
            "(one of: engine, faults, recorder, nominal, study, fleet, flight, alerts, defaults)",
        ),
        (
            "- 3",
            "1:1: error: the file must be a mapping of keys, not a list of 1 (begin it with 'kind:' and one "
            "of engine, faults, recorder, nominal, study, fleet, flight, alerts, defaults)",
        ),
    ],
)
def test_a_file_without_a_known_kind_gets_the_list(tmp_path: Path, text: str, message: str) -> None:
    file = written(tmp_path, text)
    assert complaint(kinds.check_file, file) == f"{file}:{message}"


def test_every_kind_is_known_by_its_own_name() -> None:
    assert all(name == kind.name and kind.help for name, kind in kinds.FILE_KINDS.items())


def sections_in(section: AnySection, path: str) -> Iterator[tuple[str, Section]]:
    """Every section that a declaration reaches, with the path of keys to it."""
    options = [section] if isinstance(section, Section) else section.options.values()
    for option in options:
        inside = f"{path}.{option.name}"
        yield inside, option
        for field in option.fields:
            if field.section is not None:
                yield from sections_in(field.section, f"{inside}.{field.name}")


def complete(field: Field) -> bool:
    return (
        field.kind in KINDS
        and bool(field.help)
        and (bool(field.choices) or field.kind != "choice")
        and ("section" in field.kind) == (field.section is not None)
    )


@pytest.mark.parametrize("name", list(DECLARED))
class TestEveryDeclaration:
    """What the declarations of all kinds keep, so that messages and schemas can rely on it."""

    @pytest.fixture
    def section(self, name: str) -> Section:
        module = DECLARED[name].section.partition(":")[0]
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not built")
        return DECLARED[name].load_section()

    def test_opens_with_its_kind(self, name: str, section: Section) -> None:
        assert section.fields[0].name == "kind"
        assert section.fields[0].choices == (name,)

    def test_has_fields_that_are_complete(self, name: str, section: Section) -> None:
        wrong = [
            f"{path}.{field.name}"
            for path, inner in sections_in(section, name)
            for field in inner.fields
            if not complete(field)
        ]
        assert wrong == []

    def test_has_no_key_twice(self, name: str, section: Section) -> None:
        twice = [
            path
            for path, inner in sections_in(section, name)
            if len({field.name for field in inner.fields}) < len(inner.fields)
        ]
        assert twice == []

    def test_has_defaults_that_would_be_accepted(self, name: str, section: Section) -> None:
        wrong = []
        for path, inner in sections_in(section, name):
            optional = tuple(f for f in inner.fields if not f.required and f.default not in (None, {}))
            given = {f.name: default_value(f) for f in optional}
            node = parse_document(json.dumps(given), "defaults") if given else None
            if node is not None and validate(node, Section(path, "", optional)).values != given:
                wrong.append(path)
        assert wrong == []

    def test_has_a_json_schema(self, name: str, section: Section) -> None:
        assert json.loads(json.dumps(json_schema(section)))["properties"]["kind"]["enum"] == [name]

    def test_has_a_build_that_exists(self, name: str, section: Section) -> None:
        assert not DECLARED[name].build or callable(DECLARED[name].load_build())
