"""Contact sheets: one clip for each pair of values of two parameters."""

import subprocess
from dataclasses import replace

import numpy as np
import pytest
from imageio_ffmpeg import get_ffmpeg_exe
from PIL import Image

from fracsim import Camera, Capture, Fracture, Output, Scene
from fracsim.dataset import cells, sheet
from fracsim.dataset.__main__ import main
from fracsim.sample import Writer, header_of

FRAMES, SIZE = 6, 64


def _record(folder, onset, crit, seed=0, frames=FRAMES):
    """A clip of a square that is as grey as its frame, with a stress of crit kPa; it breaks in frame 2 onset."""
    scene = Scene(
        seed=seed, fracture=Fracture(onset=onset, crit=crit), output=Output(folder=str(folder)),
        camera=Camera(width=SIZE, height=SIZE),
        capture=Capture(frames=frames, maps=["stress"], tracks=0, strip=False, report=False),
    )  # fmt: skip
    alpha = np.zeros((SIZE, SIZE), np.float32)
    alpha[16:48, 16:48] = 1
    with Writer(header_of(scene), scene.output) as writer:
        for k in range(frames):
            rgb = np.full((SIZE, SIZE, 3), 255, np.uint8)
            rgb[16:48, 16:48] = 20 * k
            writer.add(k, rgb, alpha, {"stress": 1e3 * crit * alpha[..., None]}, None)
        writer.finish({"break_frame": round(2 * onset) if onset < 2 else None}, {}, {})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """onset 1, 1.5 or 2 and crit 3 or 4, but not (2, 4); two clips with (1, 3)."""
    out = tmp_path_factory.mktemp("set")
    for onset, crit in ((1.0, 3.0), (1.0, 4.0), (1.5, 3.0), (1.5, 4.0), (2.0, 3.0)):
        _record(out, onset, crit)
    _record(out, 1.0, 3.0, seed=1)
    return out


def _sheet(folder, **options):
    by = "fracture.onset", "fracture.crit"
    return sheet.Sheet(by, cells.collect(folder, by, {}), **options)


def test_cells_hold_the_clips_of_their_values(folder):
    made = _sheet(folder)
    assert (made.rows, made.columns) == ([1.0, 1.5, 2.0], [3.0, 4.0])
    assert {key: cell.count for key, cell in made.cells.items()} == {
        (1.0, 3.0): 2, (1.0, 4.0): 1, (1.5, 3.0): 1, (1.5, 4.0): 1, (2.0, 3.0): 1}  # fmt: skip
    words = [made.cells[key].words for key in ((1.0, 3.0), (1.5, 4.0), (2.0, 3.0))]
    assert words == ["breaks at 2; first of 2", "breaks at 3", "holds"]


def test_the_frame_is_common_or_that_of_each_break(folder):
    """Breaks are at 2, 2, 3, 3: the median, the upper one of an even number, is 3."""
    first, last = (1.0, 3.0), (2.0, 3.0)
    for at, frames in (("middle", (3, 3)), ("break", (2, 3)), (1, (1, 1)), (99, (FRAMES - 1,) * 2)):
        made = _sheet(folder, at=at)
        assert (made.frame(made.cells[first]), made.frame(made.cells[last])) == frames


def test_the_picture_shows_each_clip_in_its_place(folder, tmp_path):
    """The middle of a cell is as grey as its frame; a pair of values without a clip is pale."""
    assert main(["sheet", str(folder), "--by", "fracture.onset", "--by", "fracture.crit", "--frame", "4",
                 "--out", str(tmp_path / "a.png")]) == 0  # fmt: skip
    made = _sheet(folder, at=4)
    pictures = {key: made._coloured(made._values(cell, 4, 5), 1.0)[0] for key, cell in made.cells.items()}
    page, shown = made._page(pictures), np.asarray(Image.open(tmp_path / "a.png"))
    assert all(n % 2 == 0 for n in shown.shape[:2])
    assert page.size == (SIZE, SIZE)
    top = next(y for y in range(shown.shape[0]) if (shown[y, page.left + 20 : page.left + 40] == 80).all()) - 16
    for j, expected in enumerate((80, 0xEE)):
        assert (shown[top + 2 * 90 + 32, page.left + j * page.step + 32] == expected).all()


def test_all_cells_have_one_scale(folder):
    """A stress of 4 kPa is shown as 1, one of 3 kPa as 3/4, in the colours of the legend."""
    from fracsim.sample.strip import scalar

    made = _sheet(folder, what="stress")
    values = {key: made._values(cell, 0, 1) for key, cell in made.cells.items()}
    scale = max(map(sheet._largest, values.values()))
    assert scale == pytest.approx(4e3, rel=1e-3)
    for key, fraction in (((1.0, 4.0), 1.0), ((1.0, 3.0), 0.75)):
        colour = scalar(np.full((1, 1, 1), fraction, np.float32), sheet.COLOURS)[0, 0]
        assert np.abs(made._coloured(values[key], scale)[0, 32, 32] - colour).max() <= 3
    assert made._legend(scale).endswith("0 to 4 kPa in all cells")


def test_the_video_has_all_frames(folder, tmp_path):
    path = tmp_path / "a.mp4"
    _sheet(folder).video(path)
    listing = subprocess.run([get_ffmpeg_exe(), "-v", "error", "-i", str(path), "-f", "framecrc", "-"],
                             capture_output=True, check=True).stdout.decode()  # fmt: skip
    assert sum(not line.startswith("#") for line in listing.splitlines()) == FRAMES


@pytest.mark.parametrize(("arguments", "message"), [
    (["--by", "fracture.onset"], "--by was given 1 times: give it twice"),
    (["--by", "fracture.onse", "--by", "seed"], "did you mean fracture.onset?"),
    (["--by", "seed", "--by", "fracture.crit", "--map", "flow"], "--map flow was not recorded in"),
    (["--by", "seed", "--by", "fracture.crit", "--only", "asset.name=duck"], "no finished clip with asset.name=duck"),
    (["--by", "seed", "--by", "fracture.crit", "--only", "duck"], "write FIELD=VALUE"),
])  # fmt: skip
def test_a_bad_word_is_one_clear_error(folder, capsys, arguments, message):
    assert main(["sheet", str(folder), *arguments]) == 2
    assert message in capsys.readouterr().err


def test_only_leaves_out_other_clips(folder):
    by = "fracture.onset", "fracture.crit"
    assert set(cells.collect(folder, by, {"fracture.crit": "4"})) == {(1.0, 4.0), (1.5, 4.0)}
    assert cells.collect(folder, by, {"seed": "1"})[1.0, 3.0].count == 1


def test_too_many_values_are_refused(folder):
    made = _sheet(folder)
    cell = made.cells[1.0, 3.0]
    with pytest.raises(ValueError, match=r"--by seed has 25 values, and a sheet at most 24"):
        sheet.Sheet(("seed", "fracture.crit"), {(float(k), 3.0): replace(cell) for k in range(25)})
