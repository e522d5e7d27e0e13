from __future__ import annotations

import math
from pathlib import Path

import pytest

from enginediag_cli.config import document as yaml12
from enginediag_cli.config.document import document_problems, load_document, parse_document
from enginediag_cli.errors import ConfigError, Mark


def value(text: str) -> object:
    return parse_document(f"x: {text}", "f.yaml").value["x"].value


def complaint(text: str) -> str:
    with pytest.raises(ConfigError) as raised:
        parse_document(text, "f.yaml")
    return str(raised.value)


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("1e5", 1e5),
        ("1.0e-3", 1e-3),
        ("1e-3", 1e-3),
        ("1E5", 1e5),
        ("-1.5e+2", -150.0),
        (".5", 0.5),
        ("5.", 5.0),
        ("+3.25", 3.25),
        ("-.5e1", -5.0),
    ],
)
def test_every_yaml_1_2_float_is_a_float(text: str, number: float) -> None:
    assert value(text) == number
    assert isinstance(value(text), float)


@pytest.mark.parametrize(("text", "number"), [("014", 14), ("0o14", 12), ("0x1F", 31), ("-7", -7), ("+7", 7)])
def test_a_leading_zero_does_not_make_a_number_octal(text: str, number: int) -> None:
    assert value(text) == number
    assert isinstance(value(text), int)


@pytest.mark.parametrize(
    "text",
    [
        "yes",
        "no",
        "on",
        "off",
        "Yes",
        "NO",
        "y",
        "n",
        "12:30:00",
        "1:30",
        "1_000",
        "2024-01-31",
        "0b101",
        "1e",
        "e5",
        ".",
        "-",
        "+",
        "tRue",
        "=",
        "1.2.3",
        ".5.",
    ],
)
def test_what_yaml_1_1_alone_converts_stays_text(text: str) -> None:
    if text == "-":
        text = "'-'"
    assert value(text) == text.strip("'")


def test_infinities_not_a_number_booleans_and_null_are_read() -> None:
    assert value(".inf") == math.inf
    assert value("-.Inf") == -math.inf
    assert math.isnan(value(".nan"))  # type: ignore[arg-type]
    assert value("true") is True
    assert value("FALSE") is False
    assert [value("null"), value("~"), value("")] == [None, None, None]
    assert value('"1e5"') == "1e5"
    assert value("9" * 5000) == math.inf


def test_every_node_and_key_keeps_its_place() -> None:
    root = parse_document("a: 1\nbb:\n  - x\n  - {c: 3.0}\n", "f.yaml")
    assert root.mark == Mark("f.yaml", 1, 1)
    assert root.key_marks == {"a": Mark("f.yaml", 1, 1), "bb": Mark("f.yaml", 2, 1)}
    items = root.value["bb"].value
    assert items[0].mark == Mark("f.yaml", 3, 5)
    assert items[1].mark == Mark("f.yaml", 4, 5)
    assert items[1].value["c"].mark == Mark("f.yaml", 4, 9)
    assert items[1].value["c"].text == "3.0"


def test_keys_are_text_as_written() -> None:
    assert list(parse_document("{014: a, no: b, 1.50: c, ~: d}", "f").value) == ["014", "no", "1.50", "~"]


def test_a_duplicate_key_names_both_places_at_any_depth() -> None:
    root = parse_document("a: 1\nb:\n  c: 1\n  d: 2\n  c: 3\na: 2\n", "f.yaml")
    assert sorted(map(str, document_problems(root))) == [
        "f.yaml:5:3: error: key 'c' is given twice (first given at f.yaml:3:3; keep one of them)",
        "f.yaml:6:1: error: key 'a' is given twice (first given at f.yaml:1:1; keep one of them)",
    ]


def test_an_alias_repeats_its_anchor() -> None:
    root = parse_document("a: &x {k: 1}\nb: *x\n", "f.yaml")
    assert root.value["b"] is root.value["a"]


def test_nested_aliases_are_walked_in_linear_time() -> None:
    lines = ["a0: &a0 [1, 1]"] + [f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]" for k in range(1, 60)]
    assert list(document_problems(parse_document("\n".join(lines), "f"))) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &x [*x]", "f.yaml:1:4: error: this anchor contains an alias to itself"),
        ("a: !engine 3", "f.yaml:1:4: error: '3' cannot be read with the tag '!engine'"),
        ("a: !!int three", "f.yaml:1:4: error: 'three' cannot be read with the tag '!!int'"),
        ("a: !!set {b}", "f.yaml:1:4: error: the tag '!!set' is not known here (leave it out)"),
        ("? [1]\n: 2", "f.yaml:1:3: error: a key must be a text, not a list or a mapping"),
        (
            "<<: {a: 1}",
            "f.yaml:1:1: error: merge keys '<<' are not part of YAML 1.2 "
            "(write the keys out, or use an alias for a whole value)",
        ),
    ],
)
def test_what_is_not_plain_data_is_a_problem_of_the_document(text: str, message: str) -> None:
    assert [str(problem) for problem in document_problems(parse_document(text, "f.yaml"))] == [message]


EMPTY = "f.yaml:1:1: error: the file is empty (it should open with 'kind: …', which says what it describes)"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", EMPTY),
        ("# only a comment\n", EMPTY),
        ("a:\n\t- x", "f.yaml:2:1: error: a tab stands where YAML wants spaces (indent with spaces)"),
        (
            "a: [1, 2\nb: 3",
            "f.yaml:2:2: error: not valid YAML: expected ',' or ']', but got ':' "
            "(a bracket is opened and not closed, or a comma is missing)",
        ),
        (
            "a: 'x\n",
            "f.yaml:2:1: error: not valid YAML: found unexpected end of stream (a quote is opened and not closed)",
        ),
        (
            "a: 1\n---\nb: 2\n",
            "f.yaml:2:1: error: a second document begins here (one file holds one; remove the second '---')",
        ),
        (
            "a: *x",
            "f.yaml:1:4: error: not valid YAML: found undefined alias 'x' "
            "(define it first with '&', or put a text that begins with '*' in quotes)",
        ),
        (
            "a: 1\nb: @x",
            "f.yaml:2:4: error: not valid YAML: found character '@' that cannot start any token "
            "(put a text that begins with this character in quotes)",
        ),
        ("a: 1\nb: x\x07", "f.yaml:2:5: error: the control character U+0007 is not allowed in YAML"),
        ("[" * 5000, "f.yaml: error: brackets or indentation are nested too deeply"),
    ],
)
def test_a_file_that_is_not_yaml_says_where_and_the_usual_cause(text: str, message: str) -> None:
    assert complaint(text) == message


def test_bytes_that_are_not_utf_8_are_named_with_their_place(tmp_path: Path) -> None:
    file = tmp_path / "latin.yaml"
    file.write_bytes("a: 1\nb: é 5 °C\n".encode("latin-1"))
    with pytest.raises(ConfigError) as raised:
        load_document(file)
    assert str(raised.value) == (
        f"{file}:2:4: error: the byte 0xe9 is not UTF-8 text "
        "(save the file as UTF-8; as Latin-1 this byte would be 'é')"
    )
    file.write_text("a: 1", encoding="utf-16")
    with pytest.raises(ConfigError, match="the file is UTF-16, not UTF-8"):
        load_document(file)


def test_a_byte_order_mark_is_skipped(tmp_path: Path) -> None:
    file = tmp_path / "bom.yaml"
    file.write_text("a: 1\n", encoding="utf-8-sig")
    assert load_document(file).key_marks["a"] == Mark(str(file), 1, 1)


def test_a_file_that_cannot_be_read_is_a_config_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot read the file: no such file or directory"):
        load_document(tmp_path / "absent.yaml")
    with pytest.raises(ConfigError, match="cannot read the file: is a directory"):
        load_document(tmp_path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: " + "[" * 100_000, "nested too deeply"),
        ("a: " + "{a: " * 100_000, "nested too deeply"),
        ("a:\n" + "- " * 100_000 + "b\n", "nested too deeply"),
        ("? " * 100_000, "nested too deeply"),
        ("".join(" " * k + "a:\n" for k in range(1500)), "nested too deeply"),
        ("- \n" * 1_500_000, "more than 1000000 values"),
        (":" * 1_500_000, "more than 1000000 values"),
        ("a: &a 1\nb: [" + "*a, " * 800_000 + "]\n", "more than 1000000 values"),
    ],
)
def test_deep_and_huge_documents_are_refused_before_they_are_parsed(monkeypatch, text, message):
    monkeypatch.setattr(yaml12, "_single_node", None)
    with pytest.raises(ConfigError, match=message):
        parse_document(text, "f.yaml")


def test_an_alias_of_an_alias_of_an_alias_is_one_value():
    levels = "".join(f"a{k + 1}: &a{k + 1} [{', '.join([f'*a{k}'] * 9)}]\n" for k in range(40))
    node = parse_document("a0: &a0 [x, y]\n" + levels, "f.yaml")
    assert len(list(document_problems(node))) == 0 and len(node.value) == 41
