"""The page in a real browser, from the picture to the film: by mouse, by keyboard, in two tabs, in a folder."""

import json
import math
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fracgen.annotation import album
from fracgen.annotation.place import Settings
from fracsim.scene import condition as condition_file
from fracsim.scene.condition import Condition
from tests.annotate import browser
from tests.annotate.browser import Watched
from tests.annotate.photos import CENTRE, photo
from tests.annotate.serving import command, dark

sync_api = pytest.importorskip("playwright.sync_api", reason="pip install playwright")
FIELDS = ("x1", "y1", "x2", "y2")
PULL = Condition(E=2e4, nu=0.45, category="high_stretch", onset=2.6, crit=3.0, grips=[0.3, 0.4, 0.7, 0.6],
                 velocity=[-0.2, -0.1, 0.25, 0.1], fps=50.0, caption="A duck tears.")  # fmt: skip


@pytest.fixture(scope="module", name="chromium")
def chromium_fixture() -> Iterator[Any]:
    path = browser.chromium()
    with sync_api.sync_playwright() as play:
        running = play.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield running
        running.close()


@pytest.fixture(scope="module", name="place")
def place_fixture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a photo and a film."""
    folder = tmp_path_factory.mktemp("place")
    photo(folder / "loaf.png")
    browser.film(folder / "strip.mp4")
    return folder


@pytest.fixture(scope="module", name="address")
def address_fixture(place: Path) -> Iterator[str]:
    simulate = command(place / "strip.mp4", steps=8, pause=0.25)
    with browser.served(Settings(simulate=simulate, generate=command(place / "strip.mp4"), cut=dark)) as address:
        yield address


@pytest.fixture(name="tab")
def tab_fixture(chromium: Any, address: str) -> Iterator[Watched]:
    """A page; whatever a test does, it asks nobody else, and the browser has nothing to complain of."""
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, accept_downloads=True)
    tab = Watched(context, address)
    yield tab
    context.close()
    assert [url for url in tab.requests if not url.startswith(address + "/")] == []
    assert tab.complaints == []


def test_the_whole_way_from_the_picture_to_the_film(tab: Watched, place: Path, tmp_path: Path) -> None:
    page = tab.page
    page.screenshot(path=tmp_path / "empty.png")
    tab.open(place / "loaf.png")
    assert tab.value("degrees") == 0
    middle = [(tab.value("x1") + tab.value("x2")) / 2, (tab.value("y1") + tab.value("y2")) / 2]
    assert middle == pytest.approx(CENTRE, abs=0.01)
    page.screenshot(path=tmp_path / "opened.png")

    tab.drag(2, 0.66, 0.3)  # steep, but not quite at 45 degrees
    assert tab.value("degrees") == 45
    page.select_option("#preset", "Rubber, tears late")
    assert tab.values("E", "nu", "onset", "crit") == [2e4, 0.45, 3.0, 3.3]
    page.fill("#speed", "0.4")
    page.click("#simulate .start")
    tab.until("() => document.querySelector('#simulate progress').value > 0.2")
    page.screenshot(path=tmp_path / "running.png")
    tab.until("() => document.querySelector('#simulate-film video')?.readyState >= 2")  # H.264 is decoded
    page.click("#generate .start")
    tab.until("() => document.querySelector('#generate-film video')?.readyState >= 2")
    page.screenshot(path=tmp_path / "films.png")
    assert page.evaluate("() => document.documentElement.scrollHeight <= innerHeight")  # one screen

    with page.expect_download() as download:
        page.click("#export")
    assert download.value.suggested_filename == "loaf.json"
    exported = condition_file.load(download.value.path())
    assert (exported.E, exported.category, exported.crit) == (2e4, "high_stretch", 3.3)
    page.fill("#E", "5000")
    download.value.save_as(tmp_path / "loaf.json")
    page.set_input_files("#json", tmp_path / "loaf.json")
    tab.until("() => document.getElementById('E').value === '20000'")
    with page.expect_download() as again:
        page.click("#export")
    assert condition_file.load(again.value.path()) == exported


def test_an_imported_pull_is_exported_as_it_was(tab: Watched, place: Path, tmp_path: Path) -> None:
    """Grips off the centre and velocities that are not mirrored are kept to the last digit."""
    tab.open(place / "loaf.png")
    condition_file.save(PULL, tmp_path / "pull.json")
    tab.page.set_input_files("#json", tmp_path / "pull.json")
    tab.until("() => document.getElementById('x1').value === '0.300'")
    assert not tab.page.is_checked("#mirrored")
    assert "mirrored about the object's centre" in tab.page.inner_text("#grips-note")
    with tab.page.expect_download() as download:
        tab.page.click("#export")
    assert condition_file.load(download.value.path()) == PULL


def test_grips_are_mirrored_snap_and_are_free_on_request(tab: Watched, place: Path) -> None:
    tab.open(place / "loaf.png")
    cx, cy = (tab.value("x1") + tab.value("x2")) / 2, (tab.value("y1") + tab.value("y2")) / 2
    tab.drag(1, 0.3, 0.4, key="Alt")
    x1, y1, x2, y2 = tab.values(*FIELDS)
    assert (x1, y1) == pytest.approx((0.3, 0.4), abs=0.004)  # a pixel of the screen
    assert (x2, y2) == pytest.approx((2 * cx - x1, 2 * cy - y1), abs=0.002)  # three digits are shown
    assert tab.value("degrees") % 15 != 0
    tab.drag(1, 0.32, 0.42, key="Control")
    assert tab.value("degrees") % 15 != 0
    tab.drag(1, 0.31, 0.41)
    assert tab.value("degrees") % 15 == 0
    tab.page.uncheck("#mirrored")
    before = tab.values("x2", "y2")
    tab.drag(1, 0.25, 0.7)
    assert tab.values("x2", "y2") == before
    tab.page.check("#mirrored")
    assert (tab.value("x1") + tab.value("x2")) / 2 == pytest.approx(cx, abs=0.002)


def test_numbers_and_handles_stay_tied(tab: Watched, place: Path) -> None:
    tab.open(place / "loaf.png")
    tab.page.fill("#speed", "0.2")
    tab.page.fill("#degrees", "90")
    x1, y1, x2, y2 = tab.values(*FIELDS)
    assert x1 == pytest.approx(x2, abs=0.002)
    assert y1 > y2  # the second grip is up
    tab.page.fill("#x2", "0.6")
    paper, grip = (tab.page.locator(name).bounding_box() for name in ("#paper", "#grip2"))
    at = (grip["x"] + grip["width"] / 2 - paper["x"]) / paper["width"]
    assert at == pytest.approx(0.6, abs=1e-3)
    seen = "() => document.querySelectorAll('#arrows line')[3]"
    ends = tab.page.evaluate(f"{seen}.x2.baseVal.value - {seen}.x1.baseVal.value".replace("() => ", ""))
    speed, turn = tab.value("speed"), tab.value("degrees")
    length = speed * 0.8 * paper["width"]  # 80 frames at 100 a second
    assert ends == pytest.approx(length * math.cos(math.radians(turn)), abs=1.5)


def test_stretches_and_ranges_are_checked_where_one_types(tab: Watched, place: Path) -> None:
    tab.open(place / "loaf.png")
    page = tab.page
    page.fill("#crit", "1.2")
    assert page.get_attribute("#crit", "aria-invalid") == "true"
    tab.until("() => document.getElementById('material-note').textContent.includes('greater than onset')")
    assert page.inner_text("#seen-crit") == "–"
    assert page.is_disabled("#simulate .start")
    assert page.get_attribute("#export", "href") is None
    page.fill("#crit", "2.5")
    assert page.is_enabled("#simulate .start")
    page.fill("#E", "soft")
    assert page.get_attribute("#E", "aria-invalid") == "true"
    page.fill("#E", "5e9")
    tab.until("() => document.getElementById('seen-E').classList.contains('outside')")
    assert page.inner_text("#seen-E") == "1.000 !"
    assert "outside 1e3 to 1e9 Pa" in page.inner_text("#material-note")
    page.focus("#onset-slider")
    for _ in range(4):
        page.keyboard.press("PageUp")
    onset, crit = tab.values("onset", "crit")
    assert crit >= onset + 0.05 - 1e-9  # the slider has pushed it
    page.focus("#E-slider")
    page.keyboard.press("Home")
    assert tab.value("E") == 1000  # logarithmic, from 1e3


def test_all_can_be_done_by_keyboard(tab: Watched, place: Path) -> None:
    """From the picture on: Tab reaches every control; arrows nudge, space paints; the focus is seen."""
    tab.open(place / "loaf.png")
    page = tab.page
    reached = []
    page.focus("#choose")
    for _ in range(45):
        page.keyboard.press("Tab")
        reached.append(
            page.evaluate(
                "() => document.activeElement.id || document.activeElement.name || "
                "document.activeElement.parentElement.id + '.' + document.activeElement.className"
            )
        )
        style = page.evaluate(
            "() => getComputedStyle(document.activeElement.matches('.choice input') ? "
            "document.activeElement.nextElementSibling : document.activeElement).outlineStyle"
        )
        assert style == "solid" or reached[-1] == ".", reached[-1]
        if reached[-1].startswith("generate"):
            break
    for name in ("import", "export", "grip1", "grip2", "fit", "tool", "radius", "again", "keep", *FIELDS, "degrees",
                 "mirrored", "speed", "caption", "preset", "category", "E-slider", "E", "nu", "onset", "crit",
                 "simulate.main start"):  # fmt: skip
        assert name in reached, name
    x2 = tab.value("x2")
    page.focus("#grip2")
    page.keyboard.press("ArrowRight")
    assert tab.value("x2") == pytest.approx(x2 + 0.0025, abs=0.001)
    page.keyboard.press("Shift+ArrowRight")
    assert tab.value("x2") == pytest.approx(x2 + 0.015, abs=0.001)
    page.focus("input[value=grips]")
    page.keyboard.press("ArrowRight")  # to the next choice: paint
    assert page.is_checked("input[value=paint]")
    page.focus("#mask")
    for _ in range(8):
        page.keyboard.press("Shift+ArrowUp")
    before = page.evaluate("() => document.getElementById('mask').toDataURL()")
    page.keyboard.press("Space")
    assert page.evaluate("() => document.getElementById('mask').toDataURL()") != before
    page.keyboard.press("Tab")


def test_the_cut_out_is_corrected_with_a_brush_and_the_centre_follows(
    tab: Watched, place: Path, tmp_path: Path
) -> None:
    tab.open(place / "loaf.png")
    page = tab.page
    y = tab.value("y1")
    page.check("input[value=erase]", force=True)
    page.fill("#radius", "80")
    paper = page.locator("#paper").bounding_box()
    with page.expect_response(lambda answer: answer.url.endswith("/mask")) as answer:
        page.mouse.move(paper["x"] + 0.15 * paper["width"], paper["y"] + 0.28 * paper["height"])
        page.mouse.down()
        page.mouse.move(paper["x"] + 0.85 * paper["width"], paper["y"] + 0.28 * paper["height"], steps=5)
        page.mouse.up()
    assert answer.value.ok
    tab.until("y => Number(document.getElementById('y1').value) > y + 0.02", y)  # mirrored grips go along
    page.screenshot(path=tmp_path / "erased.png")
    page.click("#undo")
    tab.until("y => Math.abs(Number(document.getElementById('y1').value) - y) < 0.004", y)
    page.click("#again")
    tab.until("() => document.getElementById('undo').disabled")


def test_the_models_picture_is_seen_and_the_preview_follows(tab: Watched, place: Path, tmp_path: Path) -> None:
    tab.open(place / "loaf.png")
    page = tab.page
    assert page.is_visible("#white")
    frame = page.locator("#white").bounding_box()
    assert frame["width"] / frame["height"] == pytest.approx(832 / 480, rel=0.01)
    before = page.get_attribute("#force", "src")
    page.check("input[value=crop]", force=True)
    tab.until("() => !document.getElementById('frame').hidden")
    frame, paper = (page.locator(name).bounding_box() for name in ("#frame", "#paper"))
    assert frame["width"] == pytest.approx(paper["width"], abs=2)
    assert frame["width"] / frame["height"] == pytest.approx(832 / 480, rel=0.01)
    tab.until("before => document.getElementById('force').getAttribute('src') !== before", before)
    tab.until(
        "() => document.getElementById('force').complete && document.getElementById('force').naturalWidth === 416"
    )
    page.screenshot(path=tmp_path / "crop.png")


def test_a_running_simulation_is_cancelled(tab: Watched, place: Path) -> None:
    tab.open(place / "loaf.png")
    tab.page.click("#simulate .start")
    tab.page.click("#simulate .cancel")
    tab.until("() => document.querySelector('#simulate p').textContent.startsWith('Cancelled')")
    assert tab.page.is_enabled("#simulate .start")


def test_two_tabs_do_not_mix_and_a_closed_one_harms_nobody(
    tab: Watched, chromium: Any, address: str, place: Path, tmp_path: Path
) -> None:
    tab.open(place / "loaf.png")
    context = chromium.new_context()
    other = Watched(context, address)
    other.open(photo(tmp_path / "tall.png", 200, 300))
    tab.page.fill("#E", "7000")
    assert other.value("E") == 6000
    other.page.click("#simulate .start")
    other.page.wait_for_selector("#simulate progress:visible")
    context.close()
    tab.page.click("#simulate .start")
    tab.until("() => document.querySelector('#simulate-film video')?.readyState >= 2")


def status(url: str) -> int:
    """The status of an answer."""
    try:
        with urllib.request.urlopen(url) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code


def test_a_page_that_is_left_ends_its_session(tab: Watched, address: str, place: Path) -> None:
    tab.open(place / "loaf.png")
    session = tab.page.get_attribute("#photo", "src").rpartition("/")[0]
    assert status(f"{address}{session}/jobs") == 200
    tab.page.goto(f"{address}/static/page.css")
    for _ in range(200):  # the browser says so after it has left
        if status(f"{address}{session}/jobs") == 404:
            return
        time.sleep(0.05)
    raise AssertionError("the session has not ended")


def test_a_broken_picture_is_told_and_the_page_goes_on(tab: Watched, place: Path, tmp_path: Path) -> None:
    (tmp_path / "broken.png").write_bytes(b"broken")
    tab.page.set_input_files("#file", tmp_path / "broken.png")
    tab.page.wait_for_selector("#alert:visible")
    assert "cannot be read as a picture" in tab.page.inner_text("#alert")
    tab.open(place / "loaf.png")
    assert tab.page.is_hidden("#alert")
    assert [c for c in tab.complaints if "422" in c] == tab.complaints  # browsers log such answers
    tab.complaints.clear()


def test_everything_has_a_name_and_contrast(tab: Watched, place: Path) -> None:
    """WCAG AA: 4.5 to 1 for text of this size."""
    tab.open(place / "loaf.png")
    tab.page.fill("#E", "5e9")
    tab.until("() => document.getElementById('seen-E').classList.contains('outside')")
    assert tab.page.evaluate(browser.NAMES) == []
    poor = [(round(ratio, 2), what) for ratio, what in tab.page.evaluate(browser.CONTRAST) if ratio < 4.5]
    assert poor == []


def test_a_dropped_picture_is_opened(tab: Watched, tmp_path: Path) -> None:
    data = tab.page.evaluate_handle(
        """async bytes => {
          const data = new DataTransfer();
          data.items.add(new File([new Uint8Array(bytes)], "dropped.png", { type: "image/png" }));
          return data;
        }""",
        list(photo(tmp_path / "small.png", 64, 48).read_bytes()),
    )
    tab.page.dispatch_event("#stage", "drop", {"dataTransfer": data})
    tab.shown("dropped.png")


def test_a_folder_is_annotated_image_by_image(chromium: Any, place: Path, tmp_path: Path) -> None:
    photo(tmp_path / "a.png", 320, 240), photo(tmp_path / "b.png", 240, 320)
    with browser.served(Settings(album=album.opened(str(tmp_path)), cut=dark)) as address:
        context = chromium.new_context(viewport={"width": 1280, "height": 800})
        tab = Watched(context, address)
        page = tab.page
        tab.shown("a.png")
        assert page.inner_text("#place") == "1 of 2, not saved yet"
        assert page.is_disabled("#generate .start")
        assert "--run" in page.inner_text("#generate")
        page.fill("#E", "8000")
        page.click("#save")
        tab.until("() => document.getElementById('place').textContent === '1 of 2, saved'")
        page.click("#next")
        tab.shown("b.png")
        page.fill("#E", "9000")
        page.once("dialog", lambda dialog: dialog.dismiss())
        page.click("#previous")
        assert page.inner_text("#name") == "b.png"
        page.once("dialog", lambda dialog: dialog.accept())
        page.click("#previous")
        tab.shown("a.png")
        assert tab.value("E") == 8000
        page.screenshot(path=tmp_path.parent / "folder.png")
        context.close()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.json", "a.png", "b.png"]
    assert json.loads((tmp_path / "a.json").read_text())["E"] == 8000
