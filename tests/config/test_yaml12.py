from __future__ import annotations

from pathlib import Path

import pytest
from config_declarations import GOOD

from enginediag_cli.config import document as yaml12
from enginediag_cli.config.document import parse_document
from enginediag_cli.errors import ConfigError

CONFIGS = sorted((Path(__file__).parents[2] / "configs").rglob("*.yaml"))

ODD = """\
empty:
  none:
  flow: {d: , e:  }
  quoted: ''
  block: |
    line one
      line two
  folded: >-
    a
    b
é: [1e5, &x {a: ~}, *x, "tab\\t", 'it''s', -.5, 012, 0x1f]
last: {}
...
"""


@pytest.mark.skipif(yaml12.FastLoader is None, reason="PyYAML without libyaml")
@pytest.mark.parametrize(
    "text",
    [GOOD, ODD, *(file.read_text(encoding="utf-8") for file in CONFIGS)],
    ids=["good", "odd", *(file.stem for file in CONFIGS)],
)
def test_both_parsers_give_the_same_nodes_at_the_same_places(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    fast = parse_document(text, "f")
    monkeypatch.setattr(yaml12, "FastLoader", None)
    assert parse_document(text, "f") == fast


@pytest.mark.parametrize("opener", ["[", "- ", "{a: ", "? "])
def test_a_hundred_thousand_levels_are_an_error_and_not_a_crash(opener: str) -> None:
    with pytest.raises(ConfigError, match="nested too deeply"):
        parse_document(opener * 100_000, "f")


@pytest.mark.parametrize(
    ("tag", "text"), [("int", "1.5"), ("float", "1e"), ("bool", "yes"), ("null", "none"), ("timestamp", "2024-01-31")]
)
def test_a_text_that_does_not_fit_its_tag_is_a_value_error(tag: str, text: str) -> None:
    with pytest.raises(ValueError, match="cannot be read with the tag"):
        yaml12.scalar_value(yaml12.TAG + tag, text)
