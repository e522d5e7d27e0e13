"""A report as a file: what it says, that strangers' text stays text, and that the same results give the same bytes."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from results_of_commands import detected, engine_files, explained, fleet, isolated, records, refined, trend

from enginediag_cli.__main__ import main
from enginediag_cli.report.plotting.interactive import available
from enginediag_cli.report.plotting.svg import shade as svg_shade
from enginediag_cli.report.result_files import read_result

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
    assert sum(tag == "script" and "type" not in attrs for tag, attrs in found.tags) == 1
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
    bare = tmp_path / "bare.csv"
    bare.write_text("".join(line for line in file.open() if not line.startswith("#")))
    assert "bare.csv does not say how it was made." in report(tmp_path, bare)


def test_recordings_and_nominal_files_say_of_themselves_what_their_heads_say(tmp_path) -> None:
    flown, nominal = tmp_path / "flown.csv", tmp_path / "nominal.yaml"
    flown.write_text("# command: simulate\n# seed: 7\nflight,time_s,T5_K\n1,0,900.5\n1,1,900.5\n")
    nominal.write_text("# comment\nkind: nominal\nprovenance:\n  recording 1: healthy.csv\nsmooth: 'yes'\n")
    assert read_result(str(flown), "flown.csv", recordings=True).provenance == ["command: simulate", "seed: 7"]
    assert read_result(str(nominal), "nominal.yaml").provenance == ["recording 1: healthy.csv"]


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
    assert "120 flights (90 %: 80 to 200)" in text and "no growth shown at present; not before" in text
    assert "LPT efficiency: rose alike in most engines" in text


def test_a_page_is_named_for_what_it_is_of(tmp_path) -> None:
    def headline(*files: Path) -> str:
        return re.findall("<h1>(.*?)</h1>", report(tmp_path, *files))[0]

    assert headline(fleet(tmp_path)) == "Fleet report"
    assert headline(explained(tmp_path), refined(tmp_path)) == "What the engine model lacks"
    assert headline(detected(tmp_path)) == "Engine report"


def test_a_worklist_without_a_limit_shows_the_margin_used_and_no_places_of_rows(tmp_path) -> None:
    file = fleet(tmp_path)
    document = json.loads(file.read_text())
    for engine in document["engines"]:
        engine["margin"] |= {"limit_K": None, "now_K": {}, "remaining_flights": {}, "reason": "no limit is stated"}
        engine["margin"]["consumed_K"] = {"value": 11.2, "low": 9.0, "high": 13.4}
    file.write_text(json.dumps(document))
    page = report(tmp_path, file)
    worklist = page[page.index("<caption class=quiet>Worklist") :]
    worklist = worklist[: worklist.index("</table>")]
    assert "11 K ± 2 K used" in worklist and "engines[" not in worklist and "flights (90" not in worklist
    assert "towards its limit" not in page


def test_engines_without_a_card_say_their_verdict_where_their_charts_are(tmp_path) -> None:
    files = [trend(tmp_path / name, name) for name in map(str, range(14)) if (tmp_path / name).mkdir() is None]
    text = " ".join("".join(words(report(tmp_path, *files)).text).split())
    assert text.count("hpc.efficiency fell by 0.80 %") == 14


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


def luminance(colour: str) -> float:
    """Relative luminance of WCAG 2.2."""
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    r, g, b = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def contrast(one: str, other: str) -> float:
    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", [0, 1], ids=["light", "dark"])
def test_words_stand_out_from_their_ground_by_four_and_a_half_to_one(scheme) -> None:
    from importlib.resources import files

    sheet = (files("enginediag_cli.report") / "page.css").read_text(encoding="utf-8")
    colours = dict(re.findall(r"--(\w+):(#[0-9a-f]{6})", re.findall(r":root\{[^}]*\}", sheet)[scheme]))
    for ground in ("paper", "soft"):
        for ink in ("ink", "quiet", "link", "changed", "cannot", "silent", "fine"):
            assert contrast(colours[ink], colours[ground]) >= 4.5, (ink, ground)


def test_words_of_pictures_stand_out_and_so_do_numbers_on_the_shades_of_heat_maps() -> None:
    from enginediag_cli.report import plotting

    for surfaces in (plotting.SURFACES_LIGHT, plotting.SURFACES_DARK):
        ink, _, paper, _, quiet, card = surfaces
        assert min(contrast(words, ground) for words in (ink, quiet) for ground in (paper, card)) >= 4.5
    for value in (-1.0, -0.7, -0.5, -0.3, -0.1, 0.1, 0.3, 0.5, 0.7, 1.0):
        fill, ink = plotting.shade(value, 1.0)
        assert contrast(fill, ink) >= 4.5
    for share in range(101):
        fill = svg_shade(share / 100)
        assert contrast(fill, plotting.ink_on(fill)) >= 4.5


def test_axes_of_dates_have_midnights_and_first_days_of_months() -> None:
    from enginediag_cli.report.plotting import date_ticks, date_words

    start = 1_767_225_600.0  # 1 January 2026
    assert [date_words(t) for t in date_ticks(start, start + 5 * 86400.0)][:2] == ["2026-01-01", "2026-01-02"]
    assert [date_words(t) for t in date_ticks(start - 1, start + 200 * 86400.0)] == [
        "2026-01-01",
        "2026-03-01",
        "2026-05-01",
        "2026-07-01",
    ]


def test_the_engine_its_flights_and_their_dates_stand_on_the_first_screen(tmp_path) -> None:
    file = detected(tmp_path, "ESN-7")
    dated = {f"{3600.0 * k + s}": f"{1_767_225_600.0 + 86400.0 * k + s}" for k in range(1, 9) for s in (0, 990)}
    text = file.read_text()
    for seconds, date in dated.items():
        text = text.replace(f",{seconds},", f",{date},")
    file.write_text(text)
    page = report(tmp_path, file)
    assert "serial number ESN-7 · 8 flights (1 to 8) · 2026-01-02 to 2026-01-09" in page
    assert ">2026-01-05</text>" in page


def steady(folder: Path, last: bool) -> list[Path]:
    """A series without a change, in which one window alarms by itself: the last, or one before."""
    text = trend(folder).read_text().splitlines()
    row = f",{8},hpc.efficiency,steady,1,1,hpc,steady,0.01,{',' * 12},1,"
    (folder / "t.csv").write_text("\n".join([*text[:4], row]) + "\n")
    rows = detected(folder).read_text().replace(",fault", ",healthy").splitlines()
    at = len(rows) - (1 if last else 4)
    rows[at] = rows[at].replace(",healthy", ",fault")
    (folder / "d.csv").write_text("\n".join(rows) + "\n")
    return [folder / "t.csv", folder / "d.csv"]


def test_an_alarm_of_the_last_window_is_never_beside_no_change(tmp_path) -> None:
    page = report(tmp_path, *steady(tmp_path, last=True))
    assert 'class="lead cannot"' in page
    assert "but the last window, flight 8, departs from nominal by itself" in page
    assert "Record the next flight" in page


def test_alarms_that_chance_makes_are_counted_and_explained(tmp_path) -> None:
    page = report(tmp_path, *steady(tmp_path, last=False))
    assert 'class="lead fine"' in page
    assert "1 of 8 windows alarms, as many as chance makes at a false-alarm rate of 1 %" in page


def test_suspects_that_flights_do_not_separate_are_an_ambiguity_group(tmp_path) -> None:
    file = trend(tmp_path)
    rows = file.read_text().replace("deterioration,0.99", "deterioration,0.55").splitlines()
    file.write_text("\n".join(r + "sensor.T3 (0.4); fan (0.03)" if ",0.55," in r else r for r in rows) + "\n")
    page = report(tmp_path, file)
    assert "these flights do not separate the suspects: hpc (0.55) or sensor.T3 (0.40)." in page
    assert 'class="lead cannot"' in page


def test_a_page_without_a_verdict_says_so_and_does_not_exit_with_0(tmp_path, capsys) -> None:
    page = tmp_path / "page.html"
    assert main(["report", str(records(tmp_path)), "--static", "-o", str(page)]) == 3
    assert "no verdict" in capsys.readouterr().err
    assert 'class="lead silent"' in page.read_text(encoding="utf-8")


def test_a_page_without_a_chart_holds_no_script_of_the_plotting_library(tmp_path) -> None:
    page = report(tmp_path, isolated(tmp_path), static=False)
    assert "<figure" not in page and len(page.encode()) < 500_000


def test_what_an_expert_needs_is_folded_and_the_heat_map_has_a_colour_bar(tmp_path) -> None:
    page = report(tmp_path, *engine_files(tmp_path))
    assert '<details class="folded"><summary>Each window by itself</summary>' in page
    heat = next(f for f in re.findall(r"<figure.*?</figure>", page, re.S) if "All components" in f)
    assert "change from nominal (%)" in heat and ">1.6<" in heat and ">−1.6<" in heat


def test_the_first_screen_is_a_picture_too(tmp_path) -> None:
    page = report(tmp_path, *engine_files(tmp_path), more=("--picture", str(tmp_path / "first.svg")))
    drawn = (tmp_path / "first.svg").read_text(encoding="utf-8")
    assert drawn.startswith("<svg") and "hpc.efficiency fell by 0.80 %" in drawn and "Health over flights" in drawn
    assert "What to do next" in drawn and page


def test_an_engine_whose_map_contradicts_healthy_is_on_the_worklist(tmp_path) -> None:
    import json

    file = fleet(tmp_path, 6, 12)
    document = json.loads(file.read_text())
    last = document["engines"][-1]
    assert last["verdict"] == "healthy"
    last["health"][0]["change"] = {"value": -0.028, "low": -0.031, "high": -0.025}
    file.write_text(json.dumps(document))
    text = " ".join("".join(words(report(tmp_path, file)).text).split())
    work = text[text.index("Worklist") : text.index("Engines by severity")]
    assert "the test over flights shows no change, but HPC isentropic efficiency fell by 2.8 %" in work
    assert "1 cannot be judged, a parameter being far off" in text


def test_an_acknowledged_finding_is_last_on_the_worklist_until_it_grows(tmp_path) -> None:
    import json

    file = fleet(tmp_path, 6, 12)
    document = json.loads(file.read_text())
    known = {"date": "2026-03-01", "flights": 10, "note": "wash planned", "changes": [], "grown": []}
    document["engines"][0]["acknowledged"] = known
    file.write_text(json.dumps(document))
    text = " ".join("".join(words(report(tmp_path, file)).text).split())
    work = text[text.index("Worklist") : text.index("Engines by severity")]
    first, second = (document["engines"][k]["serial"] for k in (0, 1))
    assert work.index(second) < work.index(first)  # the severest is known
    assert "acknowledged 2026-03-01 after 10 flights: wash planned; not raised again unless it grows" in work
    assert f"Begin with {second}" in text and "1 of them acknowledged and not grown since" in text
    document["engines"][0]["acknowledged"] = {**known, "grown": ["hpc.efficiency"]}
    file.write_text(json.dumps(document))
    text = " ".join("".join(words(report(tmp_path, file)).text).split())
    assert "since then grown: HPC isentropic efficiency" in text and f"Begin with {first}" in text


def test_the_point_of_design_lies_on_the_speed_line_of_its_compressor() -> None:
    import numpy as np

    from enginediag_cli import load_engine
    from enginediag_cli.engine.components.turbomachinery import Compressor

    network = load_engine("turbofan.yaml").network
    for compressor in (c for c in network.components if isinstance(c, Compressor)):
        flow, ratio = compressor.speed_line(network.gas, 1.0)
        assert np.interp(compressor.flow_scale, flow, ratio) == pytest.approx(
            compressor.values["pressure_ratio"], rel=0.01
        )
