"""`python -m tests.annotate.screenshot`: docs/img/annotate.png, the page with a simulated photo; takes a minute."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image
from playwright.sync_api import sync_playwright

from fracgen.annotation.place import Settings
from tests.annotate import browser

FILE = Path("docs/img/annotate.png")
PHOTO = Path("docs/photos/roll.jpg")
COLOURS = 256
"""A palette keeps the file small."""
WAIT = 600_000
"""Longest time of the simulation [ms]."""


def main() -> None:
    """Pull the roll at 15 degrees, wait for the simulation, show the moment after the break."""
    if not FILE.parent.is_dir():
        sys.exit("error: run this at the top of a checkout, where docs/img is.")
    with TemporaryDirectory() as name, browser.served(Settings()) as address, sync_playwright() as play:
        chromium = play.chromium.launch(executable_path=browser.chromium(), args=["--no-sandbox"])
        tab = browser.Watched(chromium.new_context(viewport={"width": 1280, "height": 800}), address)
        tab.open(PHOTO)
        tab.page.fill("#degrees", "15")
        tab.page.click("#simulate .start")
        tab.page.wait_for_selector("#simulate-film video, #simulate .note.bad", timeout=WAIT)
        print(tab.page.inner_text("#simulate"))
        tab.page.evaluate("""async () => {
          const film = document.querySelector("video");
          film.controls = false;
          film.pause();
          await new Promise((done) => {
            film.onseeked = done;
            film.currentTime = 0.27 * film.duration;
          });
        }""")
        shot = Path(name) / "shot.png"
        tab.page.screenshot(path=shot)
        Image.open(shot).convert("RGB").quantize(COLOURS).save(FILE, optimize=True)
        chromium.close()


if __name__ == "__main__":
    main()
