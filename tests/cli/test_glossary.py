"""`enginediag glossary`: the words of the field, found by near spellings, as text and as a page."""

from __future__ import annotations

import pytest

from enginediag_cli.glossary import GLOSSARY, search

FIELD = (
    *("EGT margin", "delta", "ambiguity group", "observability", "posterior probability", "marginal likelihood"),
    *("credible interval", "nuisance parameter", "model inadequacy", "reduced χ²", "false-alarm rate"),
    *("detection delay", "map error", "nominal file", "smearing", "water wash", "work scope"),
)


def test_the_glossary_has_the_words_of_the_field_in_order_and_whole_sentences():
    words = [entry.word for entry in GLOSSARY]
    assert set(FIELD) <= set(words)
    assert words == sorted(set(words), key=str.casefold)
    for entry in GLOSSARY:
        assert entry.meaning.endswith(".") and entry.used, entry.word
        assert entry.meaning.count(". ") <= 1, f"{entry.word}: one or two sentences"


@pytest.mark.parametrize(
    ("word", "found"),
    [
        ("ambiguty group", "ambiguity group"),
        ("EGT MARGIN", "EGT margin"),
        ("chi-squared", "reduced χ²"),
        ("margin", "EGT margin"),
        ("posterior", "posterior probability"),
    ],
)
def test_a_word_is_found_by_near_spellings_other_words_and_parts(word, found):
    assert found in [entry.word for entry in search(word)]


def test_the_command_prints_one_word_all_of_them_or_a_page(run):
    one = run("glossary", "smearing")
    assert one.exit_code == 0
    assert one.stdout.startswith("smearing\n    False distribution")
    every = [line for line in run("glossary").stdout.splitlines() if line and line[0] != " "]
    assert len(every) == len(GLOSSARY)
    page = run("glossary", "--format", "markdown").stdout
    assert page.startswith("# Glossary\n")
    assert page.count("\n| **") == len(GLOSSARY)
    unknown = run("glossary", "qqqq")
    assert unknown.exit_code == 2
    assert "no word like 'qqqq'" in unknown.stderr
