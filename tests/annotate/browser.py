"""A page in a real Chromium, on a real server in a thread."""

import os
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import uvicorn

from fracgen.annotate import HOST, listening
from fracgen.annotation.app import create
from fracgen.annotation.place import Settings
from fracsim.sample.video import Encoder

CONTRAST = """() => {
  const linear = (c) => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  const parse = (text) => {
    const n = (text.match(/[\\d.]+/g) ?? []).map(Number);
    return { rgb: n.slice(0, 3).map((v) => v / 255), a: n.length > 3 ? n[3] : 1 };
  };
  const light = (rgb) => 0.2126 * linear(rgb[0]) + 0.7152 * linear(rgb[1]) + 0.0722 * linear(rgb[2]);
  const ground = (element) => {
    for (let e = element; e; e = e.parentElement) {
      const c = parse(getComputedStyle(e).backgroundColor);
      if (c.a === 1) return c.rgb;
    }
    return [1, 1, 1];
  };
  const found = [];
  for (const element of document.querySelectorAll("body *")) {
    const own = [...element.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
    const shown = element.checkVisibility() && !element.closest("svg, option, [disabled], [aria-disabled=true]");
    if (!shown || !(own || element.matches("input[type=text], input[type=number]"))) continue;
    const [a, b] = [light(parse(getComputedStyle(element).color).rgb), light(ground(element))];
    found.push([(Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), element.outerHTML.slice(0, 80)]);
  }
  return found;
}"""
"""Contrast of each text that is shown with what is behind it, as WCAG 2.2 defines it."""
NAMES = """() => [...document.querySelectorAll("button, input, select, a, video, canvas, nav, section, aside")]
  .filter((e) => !(e.getAttribute("aria-label") || e.labels?.length || e.textContent.trim()))
  .map((e) => e.outerHTML.slice(0, 80))"""
"""Elements that a reader of screens could not name."""


def chromium() -> str:
    """The browser; without one a test is skipped, but fails where CI says that it runs."""
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if found is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)("no Chromium: apt-get install chromium")
    return found


@contextmanager
def served(settings: Settings) -> Iterator[str]:
    """The address of a server that runs as the program runs it."""
    socket = listening(0)
    server = uvicorn.Server(uvicorn.Config(create(settings), log_level="warning", timeout_graceful_shutdown=2))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [socket]})
    thread.start()
    try:
        while not server.started:
            time.sleep(0.02)
        yield f"http://{HOST}:{socket.getsockname()[1]}"
    finally:
        server.should_exit = True
        thread.join()


class Watched:
    """A page whose requests and complaints are kept."""

    def __init__(self, context: Any, address: str) -> None:
        self.page, self.address = context.new_page(), address
        self.page.set_default_timeout(20_000)
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("console", lambda said: said.type in ("error", "warning") and self.complaints.append(said.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(address)
        self.page.wait_for_selector("#choose:enabled")

    def open(self, file: Path) -> None:
        """Choose a picture and wait until all of it is shown."""
        self.page.set_input_files("#file", file)
        self.shown(file.name)

    def shown(self, name: str) -> None:
        """Wait until a picture is there, with its cut-out and its preview."""
        self.page.wait_for_function("name => document.getElementById('name').textContent === name", arg=name)
        self.page.wait_for_function("() => document.getElementById('mask').width !== 300")  # that of a canvas unused
        self.page.wait_for_function("() => document.getElementById('force').naturalWidth > 0")

    def value(self, name: str) -> float:
        """The number in a field."""
        return float(self.page.input_value(f"#{name}"))

    def values(self, *names: str) -> list[float]:
        return [self.value(name) for name in names]

    def until(self, code: str, argument: Any = None) -> None:
        """Wait until an expression of the page is true."""
        self.page.wait_for_function(code, arg=argument)

    def drag(self, grip: int, x: float, y: float, key: str = "") -> None:
        """Drag a grip to a place in widths and heights of the picture, with a key held."""
        mouse, paper = self.page.mouse, self.page.locator("#paper").bounding_box()
        box = self.page.locator(f"#grip{grip}").bounding_box()
        mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        mouse.down()
        if key:
            self.page.keyboard.down(key)
        mouse.move(paper["x"] + paper["width"] * x, paper["y"] + paper["height"] * y, steps=4)
        mouse.up()
        if key:
            self.page.keyboard.up(key)


def film(path: Path) -> Path:
    """A film as strip.mp4 is one: five panels side by side that change."""
    with Encoder(path, 1304, 284, "strip") as encoder:
        for k in range(8):
            picture = np.full((284, 1304, 3), 255, np.uint8)
            for panel in range(5):
                left = 4 + 260 * panel
                picture[24:280, left : left + 256] = (40 * panel + 20, 120, 200 - 30 * panel)
                picture[100:200, left + 60 - 4 * k : left + 196 + 4 * k] = (200, 140, 70)
            encoder.write(picture)
    return path
