from __future__ import annotations

import numpy as np
import pytest
import yaml

from enginediag_cli.config.document import Node, dump, parse_document

TEXTS = [
    "1e5",
    "no",
    "0o14",
    "014",
    "12:30",
    "1_000",
    "",
    "~",
    "null",
    "x: y",
    "# x",
    "é°²",
    "-",
    ".5",
    "<<",
    "a\nb",
    "2024-01-31",
    " padded ",
    "'",
    '"',
    "{",
    "@",
    "true",
    "0x1f",
    "1.0e+5",
]


def plain(node: Node) -> object:
    if node.is_mapping:
        return {key: plain(child) for key, child in node.value.items()}
    return [plain(child) for child in node.value] if node.is_list else node.value


def test_every_float_comes_back_to_the_last_bit() -> None:
    rng = np.random.default_rng(5)
    floats = [float(x) for x in rng.standard_normal(300) * 10.0 ** rng.integers(-300, 300, 300)]
    values = {"numbers": [*floats, 0.0, -0.0, 1e22, 5e-324, 1e16, 123456789.0, 1e-5]}
    assert plain(parse_document(dump(values), "f")) == values


@pytest.mark.parametrize("text", TEXTS)
def test_every_text_comes_back_as_text_here_and_in_yaml_1_1(text: str) -> None:
    assert plain(parse_document(dump({"x": text}), "f")) == {"x": text}
    assert yaml.safe_load(dump({"x": text})) == {"x": text}


def test_keys_that_look_like_numbers_come_back_as_text_in_their_order() -> None:
    values = {"b": 1, "1e5": {"no": None}, "a": [True, {"c": [1, 2]}]}
    assert plain(parse_document(dump(values), "f")) == values
    assert list(parse_document(dump(values), "f").value) == ["b", "1e5", "a"]
