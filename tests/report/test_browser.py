"""Pages in a real browser: no request to any network, nothing in the console, charts draw, filter and hover work."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import CHROMIUM, Browser
from results_of_commands import engine_files, fleet, records
from washed_engine import make

from enginediag_cli.__main__ import main
from enginediag_cli.report.plotting.interactive import available

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(not CHROMIUM, reason="no Chromium here: apt-get install chromium"),
]
moving = pytest.mark.skipif(not available(), reason="no bokeh here: pip install 'enginediag[report]'")

DRAWN = "document.querySelectorAll('figure[data-drawn=yes]').length"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder, Browser(Path(folder)) as found:
        yield found


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of one engine, with residuals."""
    folder = tmp_path_factory.mktemp("engine")
    files = [*engine_files(folder), records(folder, 3000)]
    assert main(["report", *map(str, files), "-q", "-o", str(folder / "page.html")]) == 0
    return folder / "page.html"


def opened(browser: Browser, page: Path, width: int = 1200, height: int = 9000, *, phone: bool = False) -> float:
    browser.errors.clear()
    browser.requests.clear()
    browser.size(width, height, phone=phone)
    return browser.open(page)


def foreign(browser: Browser) -> list[str]:
    """Requests that are neither for the page itself nor for what stands in it."""
    return [url for url in browser.requests if not url.startswith(("file:", "data:", "about:"))]


@moving
def test_a_page_opens_from_a_file_draws_every_chart_and_asks_nothing_of_any_network(browser, page) -> None:
    opened(browser, page)
    browser.value("document.querySelectorAll('details.folded').forEach(d => { d.open = true; })")
    browser.wait(f"{DRAWN} === document.querySelectorAll('figure').length")
    assert browser.value("Bokeh.documents.length") >= 4
    assert browser.value("document.querySelectorAll('.drawn').length") >= 4  # for paper
    assert browser.errors == []
    assert foreign(browser) == []


@moving
def test_a_series_is_hidden_by_its_button_which_the_keyboard_reaches(browser, page) -> None:
    opened(browser, page)
    browser.wait(f"{DRAWN} > 0")
    first = "document.querySelector('figure .legend button')"
    browser.wait(f"!!{first}")
    browser.value(f"{first}.focus()")
    assert browser.value(f"document.activeElement === {first}")
    shown = "Bokeh.documents[0].roots()[0].renderers.filter(r => r.visible).length"
    before = browser.value(shown)
    browser.value(f"{first}.click()")
    assert browser.value(shown) < before
    assert browser.value(f"{first}.getAttribute('aria-pressed')") == "false"


@moving
def test_the_pointer_on_a_dot_tells_its_value_and_the_row_that_it_came_from(browser, page) -> None:
    opened(browser, page, 1200, 1400)
    browser.wait(f"{DRAWN} > 0")
    place = browser.value(
        """(() => { const view = Object.values(Bokeh.index.roots ? Bokeh.index.roots : Bokeh.index)[0];
        const frame = view.frame, box = view.canvas_view.el.getBoundingClientRect();
        const r = view.model.renderers.find(r => r.glyph.type === 'Scatter');
        const d = r.data_source.data;
        return {x: box.left + frame.bbox.left + frame.x_scale.compute(d.x[3]) - frame.bbox.left,
                y: box.top + frame.y_scale.compute(d.y[3])}; })()"""
    )
    browser.move(place["x"] - 3, place["y"])
    browser.move(place["x"], place["y"])
    told = (
        "(function t(n){let s='';n.childNodes.forEach(c=>{s+=c.nodeType===3?c.data:t(c)});"
        "if(n.shadowRoot)s+=t(n.shadowRoot);return s})(document.querySelector('.live'))"
    )
    browser.wait(f"{told}.includes('line')")
    assert "line" in browser.value(told)


def test_without_scripts_the_page_reads_as_well(browser, page) -> None:
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder, Browser(Path(folder)) as plain:
        plain.without_scripts()
        plain.size(1200, 3000)
        plain.open(page)
        plain._call("Emulation.setScriptExecutionDisabled", {"value": False})
        assert plain.value("document.querySelectorAll('.drawn svg').length") >= 4
        assert plain.value("document.querySelectorAll('figure[data-drawn=yes]').length") == 0
        assert plain.value("document.querySelector('.verdict').textContent").startswith("hpc.efficiency fell by")


@pytest.mark.parametrize("width, phone", [(1200, False), (390, True)])
def test_the_page_is_never_wider_than_the_screen(browser, page, width, phone) -> None:
    opened(browser, page, width, 900, phone=phone)
    assert browser.value("document.documentElement.scrollWidth") <= width


@pytest.mark.slow
def test_eight_charts_of_5000_points_open_in_under_a_second(browser, tmp_path) -> None:
    files = []
    for k in range(8):
        folder = tmp_path / str(k)
        folder.mkdir()
        text = records(folder, 2000).read_text().replace("source,line,flight", "engine,source,line,flight")
        lines = [line if line.startswith(("#", "engine")) else f"E{k},{line}" for line in text.splitlines()]
        files.append(tmp_path / f"r{k}.csv")
        files[-1].write_text("\n".join(lines) + "\n")
    page = tmp_path / "many.html"
    assert main(["report", *map(str, files), "-q", "-o", str(page)]) == 3  # residuals are no verdict
    assert page.stat().st_size < 6_000_000
    opened(browser, page, 1200, 900)
    times = "performance.getEntriesByType('navigation')[0]"
    assert min(_seconds(browser, page, times) for _ in range(3)) < 1.0


def _seconds(browser: Browser, page: Path, times: str) -> float:
    opened(browser, page, 1200, 900)
    return browser.value(f"{times}.domComplete - {times}.startTime") / 1000


def test_a_fleet_is_read_on_a_phone_in_the_dark(browser, tmp_path) -> None:
    assert main(["report", str(fleet(tmp_path, 3, 9)), "-q", "-o", str(tmp_path / "fleet.html")]) == 0
    browser.dark()
    opened(browser, tmp_path / "fleet.html", 390, 844, phone=True)
    assert browser.errors == []
    assert browser.value("getComputedStyle(document.body).backgroundColor") == "rgb(27, 34, 43)"
    browser.dark(False)


@pytest.mark.parametrize("width, phone", [(1200, False), (390, True)])
def test_the_margin_of_one_engine_is_drawn_with_its_wash_and_is_no_wider_than_the_screen(
    browser, washed, width, phone
) -> None:
    opened(browser, washed, width, 6000, phone=phone)
    drawn = "document.getElementById('engine-1-margin')"
    if available():
        browser.wait(f"{drawn}.dataset.drawn === 'yes'")
    assert browser.value(f"{drawn}.querySelector('.drawn').textContent").find("wash") >= 0
    assert browser.value("document.documentElement.scrollWidth") <= width
    box = f"{drawn}.getBoundingClientRect()"
    assert browser.value(f"{box}.right") <= width and browser.value(f"{box}.height") > 200
    assert browser.errors == [] and foreign(browser) == []


@pytest.fixture(scope="module")
def washed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of an engine that was washed, with a limit."""
    folder = tmp_path_factory.mktemp("washed")
    recording = make(folder)
    asked = ["--limit", "T5_K", "1050", "--events", str(folder / "washes.csv"), "--baseline", "3"]
    page = str(folder / "page.html")
    assert main(["report", "-n", str(folder / "nominal.yaml"), str(recording), *asked, "-q", "-o", page]) == 0
    return folder / "page.html"
