"""Pictures that come in: what is taken, what is refused, and that a refusal leaves the page as it was."""

import io
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fastapi.testclient import TestClient
from PIL import Image

from fracgen.annotation import sessions, uploads
from fracgen.sampling import picture
from tests.annotate.photos import CENTRE, RADII, photo
from tests.annotate.serving import Tab, served


@pytest.fixture(scope="module", name="client")
def client_fixture() -> Iterator[TestClient]:
    with served() as client:
        yield client


@pytest.fixture(name="tab")
def tab_fixture(client: TestClient) -> Tab:
    return Tab(client)


@pytest.fixture(scope="module", name="loaf")
def loaf_fixture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return photo(tmp_path_factory.mktemp("loaf") / "loaf.png")


def header(width: int, height: int) -> bytes:
    """A PNG whose header claims a size; its pixels are a few bytes."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    size = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", size) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


def test_a_picture_is_opened_with_its_object(tab: Tab, loaf: Path) -> None:
    """The centre of the loaf's box is that of the loaf; both radii are good to a few pixels of 640."""
    opened = tab.upload(loaf).json()
    assert opened["size"] == opened["shown"] == [640, 480]
    assert opened["object"]["centre"] == pytest.approx(CENTRE, abs=0.01)
    assert opened["object"]["extent"] == pytest.approx(2 * RADII[0], abs=0.02)
    shown = Image.open(io.BytesIO(tab.get("picture.jpg").content))
    assert shown.size == (640, 480)
    mask = np.asarray(Image.open(io.BytesIO(tab.get("mask.png").content)))
    assert set(np.unique(mask)) == {0, 255}
    assert mask[254, 320] == 255
    assert mask[10, 10] == 0


@pytest.mark.parametrize("size", [(70_000, 70_000), (60_000, 1_100), (8001, 8000)])
def test_pictures_of_too_many_pixels_are_refused_by_their_header(tab: Tab, size: tuple[int, int]) -> None:
    """A decompression bomb: a few bytes that would be gigabytes of pixels. None is decompressed."""
    answer = tab.request("PUT", "picture", content=header(*size))
    assert answer.status_code == 422
    assert "pixels" in answer.json()["error"]


def test_a_body_beyond_the_cap_is_refused_while_it_comes(tab: Tab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uploads, "PICTURE_BYTES", 1000)
    answer = tab.request("PUT", "picture", content=b"x" * 1001)
    assert answer.status_code == 413
    assert "make it smaller" in answer.json()["error"]


@pytest.mark.parametrize("content", [
    b"", b"no picture", b"GIF89a", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n",
    b"\x89PNG\r\n\x1a\n" + b"\0" * 50, b"<svg xmlns='x'/>", header(64, 64),
])  # fmt: skip
def test_broken_and_foreign_files_are_refused_and_the_page_goes_on(tab: Tab, loaf: Path, content: bytes) -> None:
    tab.upload(loaf)
    answer = tab.request("PUT", "picture", content=content)
    assert answer.status_code == 422
    assert "picture" in answer.json()["error"]
    assert "/tmp" not in answer.json()["error"]
    assert tab.get("box", fit="fit").status_code == 200
    assert tab.upload(loaf).status_code == 200


def test_a_cut_short_jpeg_is_refused(tab: Tab, loaf: Path) -> None:
    out = io.BytesIO()
    Image.open(loaf).save(out, "JPEG")
    assert tab.request("PUT", "picture", content=out.getvalue()[: len(out.getvalue()) // 2]).status_code == 422


def test_a_photo_of_a_phone_is_upright(tab: Tab, loaf: Path) -> None:
    """Orientation 6 is a quarter turn."""
    exif, out = Image.Exif(), io.BytesIO()
    exif[0x0112] = 6
    Image.open(loaf).save(out, "JPEG", exif=exif)
    assert tab.request("PUT", "picture", content=out.getvalue()).json()["size"] == [480, 640]


def test_a_picture_without_object_can_be_painted(tab: Tab, tmp_path: Path) -> None:
    Image.new("RGB", (320, 200), "white").save(tmp_path / "white.png")
    opened = tab.upload(tmp_path / "white.png").json()
    assert opened["object"] is None
    assert "nothing is brown: paint it" in opened["note"]
    assert tab.start().status_code == 422
    painted = Image.new("L", (320, 200))
    painted.paste(255, (80, 50, 240, 150))
    out = io.BytesIO()
    painted.save(out, "PNG")
    found = tab.request("PUT", "mask", content=out.getvalue()).json()["object"]
    assert found["centre"] == pytest.approx([0.5, 0.5])
    assert found["extent"] == pytest.approx(0.5)


def test_a_painted_cut_out_of_a_large_photo_is_made_as_large(tab: Tab, tmp_path: Path) -> None:
    opened = tab.upload(photo(tmp_path / "large.png", 1600, 1200)).json()
    assert (opened["size"], opened["shown"]) == ([1600, 1200], [1280, 960])
    out = io.BytesIO()
    Image.new("L", (1280, 960), 0).save(out, "PNG")
    assert tab.request("PUT", "mask", content=out.getvalue()).json()["object"] is None
    assert Image.open(io.BytesIO(tab.get("mask.png").content)).size == (1600, 1200)
    assert tab.request("POST", "mask/again").json()["object"]["centre"] == pytest.approx(CENTRE, abs=0.01)


def test_a_cut_out_of_another_size_is_refused(tab: Tab, loaf: Path) -> None:
    tab.upload(loaf)
    out = io.BytesIO()
    Image.new("L", (64, 48), 255).save(out, "PNG")
    assert tab.request("PUT", "mask", content=out.getvalue()).status_code == 422
    assert tab.request("PUT", "mask", content=header(640, 480)).status_code == 422
    assert tab.get("mask.png").status_code == 200


def test_before_a_picture_there_is_nothing_to_see(tab: Tab) -> None:
    for path in ("picture.jpg", "mask.png", "box?fit=fit", "reference.jpg?fit=fit", "jobs"):
        assert tab.get(path).status_code == 404, path


def test_two_tabs_share_nothing(client: TestClient, loaf: Path, tmp_path: Path) -> None:
    one, other = Tab(client), Tab(client)
    assert one.token != other.token
    one.upload(loaf)
    assert other.get("picture.jpg").status_code == 404
    other.upload(photo(tmp_path / "small.png", 320, 240))
    assert Image.open(io.BytesIO(one.get("picture.jpg").content)).size == (640, 480)
    one.request("POST", "end")
    assert one.get("picture.jpg").status_code == 404
    assert other.get("picture.jpg").status_code == 200


def test_the_tab_that_was_silent_longest_makes_room(loaf: Path) -> None:
    with served() as client:
        tabs = [Tab(client) for _ in range(sessions.MOST)]
        tabs[0].upload(loaf)
        Tab(client)
        assert [tab.get("picture.jpg").json()["error"][:15] for tab in tabs[1:2]] == ["This page is no"]
        assert tabs[0].get("picture.jpg").status_code == 200


@pytest.mark.parametrize("fit", ["fit", "crop"])
def test_the_model_sees_the_picture_that_sampling_loads(tab: Tab, loaf: Path, fit: str) -> None:
    """JPEG of quality 88 is off by a few grey levels on average."""
    tab.upload(loaf)
    seen = np.asarray(Image.open(io.BytesIO(tab.get("reference.jpg", fit=fit).content)), float)
    expected = picture.load(loaf, 832, 480, fit)
    assert np.abs(seen - expected.pixels).mean() < 3
    left, top, width, height = tab.get("box", fit=fit).json()
    assert [-left / width, -top / height] == pytest.approx(expected.corner)
    assert [1 / width, 1 / height] == pytest.approx(expected.size)
