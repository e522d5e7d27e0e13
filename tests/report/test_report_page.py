"""A report as a file: what it says, that strangers' text stays text, and that the same results give the same bytes."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from results_of_commands import detected, engine_files, explained, fleet, isolated, records, refined, trend

from enginediag_cli.__main__ import main
from enginediag_cli.report.plotting.interactive import available

FETCHES = re.compile(
    r"""(?:src|href|action|data|poster)\s*=\s*["']?\s*(?:https?:|//)|@import|url\(\s*["']?(?:https?:|//)"""
)
LIMIT = 6_000_000
"""Bytes of a file that can be mailed."""


def report(folder: Path, *files: Path, static: bool = True, name: str = "page.html", more: tuple[str, ...] = ()) -> str:
    options = ["--static"] if static else []
    code = main(["report", *map(str, files), "-q", *options, *more, "-o", str(folder / name)])
    assert code in (0, 3)
    return (folder / name).read_text(encoding="utf-8")


class Words(HTMLParser):
    """Text outside scripts and styles, and every tag."""

    def __init__(self) -> None:
        super().__init__()
        self.text: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self._silent = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._silent += tag in ("script", "style")

    def handle_endtag(self, tag: str) -> None:
        self._silent -= tag in ("script", "style")

    def handle_data(self, data: str) -> None:
        if not self._silent:
            self.text.append(data)


def words(page: str) -> Words:
    parser = Words()
    parser.feed(page)
    return parser


def test_the_first_screen_says_what_changed_how_surely_since_when_and_what_to_do(tmp_path) -> None:
    text = " ".join("".join(words(report(tmp_path, *engine_files(tmp_path))).text).split())
    first = text[: text.index("Excluded data")]
    assert "hpc.efficiency fell by 0.80 % ± 0.10 % and hpc.flow_capacity fell by 1.60 % ± 0.10 %." in first
    assert "8 flights (1 to 8)" in first
    assert "probability 0.99 that it changed, by 8 flights together; 5 of 8 windows alarm by themselves" in first
    assert "flight 4 (counted from the first, between 4 and 5), 2026-01-05, growing" in first
    assert "What to do next" in first and "Inspect the hpc" in first


def test_an_answer_that_is_hardly_likelier_than_others_is_no_headline_without_a_doubt(tmp_path) -> None:
    file = trend(tmp_path)
    file.write_text(file.read_text().replace("hpc,deterioration,0.99", "hpc,deterioration,0.61"))
    page = report(tmp_path, file)
    text = " ".join("".join(words(page).text).split())
    assert "Something changed, and what is not settled; the likeliest (0.61): hpc.efficiency fell by 0.80 %" in text
    assert 'class="lead changed"' not in page and "the engine itself shows no change" not in text


def test_what_no_change_explains_is_told_as_physics_that_the_model_lacks(tmp_path) -> None:
    file = isolated(tmp_path)
    file.write_text(file.read_text().replace('"fit": 1.0', '"fit": 4.78'))
    text = " ".join("".join(words(report(tmp_path, file, trend(tmp_path))).text).split())
    assert "no change explains them (reduced χ² 4.78): ask explain what the model lacks" in text
    assert "Nearest to it: hpc.efficiency fell by 0.80 %" in text


def test_what_would_flip_the_answer_is_told_where_the_results_have_it(tmp_path) -> None:
    import json

    rows = json.loads(isolated(tmp_path).read_text())
    for row in rows:
        row["flips"] = [{"what": "T3", "size": 2.1, "unit": "K", "words": "T3 read 2.1 K higher <b>"}]
    (tmp_path / "flips.json").write_text(json.dumps(rows))
    page = report(tmp_path, tmp_path / "flips.json")
    assert "Sensitivity of the conclusion" in page
    assert "T3 read 2.1 K higher &lt;b&gt;" in page


def test_results_in_any_order_and_under_any_name_are_known_by_what_they_hold(tmp_path) -> None:
    files = engine_files(tmp_path)
    swapped = tmp_path / "odd"
    swapped.mkdir()
    for number, file in enumerate(reversed(files)):
        ending = file.suffix
        (swapped / f"x{number}{ending}").write_bytes(file.read_bytes())
    page = report(tmp_path, *sorted(swapped.iterdir()))
    assert "hpc.efficiency fell by 0.80" in page


@pytest.mark.parametrize(
    "text, said",
    [
        ("a,b\n1,2\n", "not recognised (it has a, b)"),
        ("time_s,T3_K,N2_rpm\n0,700,9000\n", "this is a recording, not a result: give -n NOMINAL"),
        ("", "the file is empty"),
        ("{\n oops", "not JSON"),
        ("[1, 2]", "not a list of rows"),
        ("verdict,statistic,threshold,p_value,alarm\nhealthy,1\n", ":2: 2 fields where the header has 5"),
    ],
)
def test_what_is_no_result_is_refused_with_what_it_is_and_how_to_mend_it(tmp_path, capsys, text, said) -> None:
    (tmp_path / "x.csv").write_text(text)
    assert main(["report", str(tmp_path / "x.csv"), "-o", str(tmp_path / "p.html")]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "p.html").exists()


def test_a_cell_that_is_no_number_is_told_by_file_line_and_column(tmp_path, capsys) -> None:
    file = detected(tmp_path)
    file.write_text(file.read_text().replace("24.8", "high", 1))
    assert main(["report", str(file), "-q", "-o", str(tmp_path / "p.html")]) == 2
    assert "d.csv:5:threshold: not a number: 'high'" in capsys.readouterr().err


def test_an_engine_that_could_not_be_judged_is_never_called_healthy(tmp_path) -> None:
    file = detected(tmp_path)
    file.write_text(
        re.sub(r",(healthy|fault)\n", ",no verdict\n", file.read_text()).replace(",,98,", ",too few records,98,")
    )
    page = report(tmp_path, file)
    assert "Nothing could be judged: too few records." in page
    assert 'class="lead silent"' in page and "agree" not in "".join(words(page).text)


HOSTILE = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>"


@pytest.mark.parametrize(
    "static", [True, pytest.param(False, marks=pytest.mark.skipif(not available(), reason="no bokeh"))]
)
def test_names_out_of_files_stay_text_wherever_they_stand(tmp_path, static) -> None:
    safe = HOSTILE.replace('"', "").replace(",", "")
    files = [detected(tmp_path, safe), trend(tmp_path, safe)]
    text = fleet(tmp_path, 3, 10).read_text().replace("ESN-1000", "</script><script>alert(3)</script>")
    (tmp_path / "fleet.json").write_text(text)
    page = report(tmp_path, *files, tmp_path / "fleet.json", static=static, more=("--title", HOSTILE))
    found = words(page)
    assert not any(tag == "img" or any(name.startswith("on") for name in attrs) for tag, attrs in found.tags)
    assert sum(tag == "script" and "type" not in attrs for tag, attrs in found.tags) == (1 if static else 2)
    assert "alert(1)" in "".join(found.text)


@pytest.mark.parametrize(
    "static", [True, pytest.param(False, marks=pytest.mark.skipif(not available(), reason="no bokeh"))]
)
def test_a_page_names_no_address_and_the_same_files_give_the_same_bytes(tmp_path, static) -> None:
    files = [*engine_files(tmp_path), records(tmp_path), explained(tmp_path), refined(tmp_path), fleet(tmp_path, 3, 9)]
    page = report(tmp_path, *files, static=static)
    assert page == report(tmp_path, *files, static=static)
    assert FETCHES.findall(page) == []
    assert re.findall(r"""["'`](?:https?|wss?)://(?!www\.w3\.org/)""", page) == []
    assert len(page.encode()) < LIMIT
    assert "default-src 'none'" in page


def test_every_chart_has_its_table_with_the_place_of_each_row(tmp_path) -> None:
    page = report(tmp_path, *engine_files(tmp_path), records(tmp_path), refined(tmp_path), fleet(tmp_path, 4, 12))
    figures = re.findall(r"<figure.*?</figure>", page, re.S)
    assert len(figures) >= 13
    for figure in figures:
        assert "<details><summary>Table: " in figure and "<td" in figure
        assert 'role="group" aria-label=' in figure and "<title>" in figure
    detect = next(f for f in figures if "Does it depart" in f)
    assert "<td>8<td>fault<td class=n>908<td class=n>24.8<td class=n>0<td class=n>1.01<td class=n>98<td>12" in detect
    assert "from d.csv" in detect


def test_the_page_says_the_command_the_hashes_and_what_the_files_say_of_themselves(tmp_path) -> None:
    from enginediag_cli.recordings.source import file_sha256

    file = detected(tmp_path)
    page = report(tmp_path, file)
    assert "enginediag report --output page.html --static d.csv" in page or "enginediag report" in page
    assert file_sha256(file) in page
    assert "seed: 3" in page


def test_missing_physics_shows_places_law_before_and_after(tmp_path) -> None:
    text = "".join(words(report(tmp_path, explained(tmp_path), refined(tmp_path))).text)
    for said in (
        "Missing: Reynolds number",
        "Where model and recordings differ",
        "What the model lacks at cooling",
        "496",
    ):
        assert said in text
    assert "Unseen flights, before and after" in text and "1 of 2 without gain" in text


def test_a_fleet_begins_with_how_many_changed_the_bound_and_where_to_begin(tmp_path) -> None:
    text = " ".join("".join(words(report(tmp_path, fleet(tmp_path))).text).split())
    assert "10 of 30 engines changed; 20 show no change." in text
    assert "at most 5 % are healthy on average" in text
    assert "Begin with ESN-1000: Inspect the HPC" in text
    assert "120 (90 %: 80 to 200)" in text and "to no end in sight" in text
    assert "LPT efficiency: rose alike in most engines" in text


def test_a_thousand_engines_stay_a_page_that_can_be_mailed(tmp_path) -> None:
    assert len(report(tmp_path, fleet(tmp_path, 1000, 5)).encode()) < LIMIT - 1_400_000


def test_recordings_of_no_named_engine_are_told_to_be_taken_for_one(tmp_path) -> None:
    text = detected(tmp_path).read_text()
    (tmp_path / "other.csv").write_text(text.replace("flights.csv", "more.csv"))
    page = report(tmp_path, tmp_path / "d.csv", tmp_path / "other.csv")
    assert "flights.csv and more.csv name no engine" in page


def test_what_two_files_tell_of_the_same_windows_is_refused_and_not_counted_twice(tmp_path, capsys) -> None:
    file = detected(tmp_path)
    (tmp_path / "copy.csv").write_bytes(file.read_bytes())
    assert main(["report", str(file), str(tmp_path / "copy.csv"), "-o", str(tmp_path / "p.html")]) == 2
    assert (
        "d.csv and copy.csv both hold verdicts of the same part of an engine without a name" in capsys.readouterr().err
    )
