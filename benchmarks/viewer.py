"""How long a viewer takes to answer: from an event to its first picture, and to the final one."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import wvr
from studies.base.harness import Contender, Result, Settings, Time, bars, interleave, machine, summarize
from studies.base.scenes import DATA
from wvr.viewer.outbox import framed
from wvr.viewer.session import Session
from wvr.viewer.viewer import source_of

BONSAI = DATA / "bonsai.nrrd"
BASELINE = "coarse picture"
# Events of a run: of them, the 95th percentile is told.
EVENTS = 40
CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
# A page's own clock: from a key's event to the canvas that has the first picture after it.
ANSWERS = """async (count) => {
  const root = document.getElementById('viewer'), canvas = document.querySelector('canvas.wvr-picture')
  const seconds = []
  for (let n = 0; n < count; n++) {
    const start = performance.now()
    const drawn = new Promise((resolve) => root.addEventListener('wvr-picture', resolve, { once: true }))
    canvas.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowLeft' }))
    await drawn
    seconds.push((performance.now() - start) / 1000)
    await new Promise((resolve) => window.setTimeout(resolve, 60 + 60 * Math.random()))
  }
  return seconds
}"""


def measure(settings: Settings) -> Result:
    """Seconds from an event to pictures, in a session and in a page."""
    size = 48 if settings.quick else 512
    bonsai = BONSAI.exists() and not settings.quick
    data = wvr.read(BONSAI) if bonsai else wvr.datasets.load("tree", 32 if settings.quick else 256)
    events = 3 if settings.quick else EVENTS
    tails: dict[str, list[float]] = {}
    notes = [
        f"{'CT of a bonsai' if bonsai else 'The generated tree'}, {data.dimensions[0]}³, as wvr.view shows it by "
        f"default, lit; {size} x {size} pixels.",
        f"Each run is {events} turns by a key, each 60 to 120 ms after the picture of the one before; seconds are the "
        "median of a run, p95 the 95th percentile of a run; both are medians of the runs.",
        "Coarse picture: until it is encoded. Page: headless Chromium on the same machine, until it is drawn.",
    ]
    with ExitStack() as stack:
        source = source_of(data, None, {})
        session = stack.enter_context(_session(source, size))
        contenders: dict[str, Contender] = {
            BASELINE: _answers(session, events, tails),
            "final picture": _final(session),
        }
        try:
            contenders["first picture on a page"] = stack.enter_context(_page(data, size, events, tails))
        except (ImportError, RuntimeError) as error:
            notes.append(f"No page: {str(error).splitlines()[0]}.")
        times = interleave(contenders, settings.rounds, {"final picture": max(settings.rounds - 1, 1)})

    def extra(name: str, wall: float) -> dict[str, float | None]:
        return {"p95 [s]": float(np.median(tails[name][1:])) if name in tails else None}

    rows = summarize("viewer", times, BASELINE, extra)
    return Result("viewer", "Until a picture is there, after an event", BASELINE, rows, notes, machine())


def charts(result: Result) -> dict[str, Figure]:
    """By file name."""
    return {"viewer": bars(result, lambda row: (row.wall, row.fastest, row.slowest), "Wall clock [s]")}


class _Watched:
    """A session, and when its pictures came."""

    def __init__(self, source: Any, size: int):
        self.came = threading.Event()
        self.session = Session(source, self._put)
        self.session.receive({"type": "resize", "width": size, "height": size, "pixel_ratio": 1})

    def _put(self, message: dict[str, Any], picture: Any) -> None:
        if picture is not None:
            framed(message, picture)
            self.came.set()

    def turn(self) -> None:
        self.session.receive({"type": "key_down", "key": "ArrowLeft", "modifiers": []})


@contextmanager
def _session(source: Any, size: int) -> Iterator[_Watched]:
    watched = _Watched(source, size)
    try:
        watched.session.settle()
        yield watched
    finally:
        watched.session.close()


def _answers(watched: _Watched, events: int, tails: dict[str, list[float]]) -> Contender:
    rng = np.random.default_rng(0)

    def run() -> Time:
        seconds = []
        cpu = time.process_time()
        for _ in range(events):
            time.sleep(rng.uniform(0.06, 0.12))
            watched.came.clear()
            start = time.perf_counter()
            watched.turn()
            watched.came.wait()
            seconds.append(time.perf_counter() - start)
        tails.setdefault(BASELINE, []).append(float(np.quantile(seconds, 0.95)))
        return Time(float(np.median(seconds)), (time.process_time() - cpu) / events)

    return run


def _final(watched: _Watched) -> Contender:
    def run() -> Time:
        wall, cpu = time.perf_counter(), time.process_time()
        watched.turn()
        watched.session.settle()
        return Time(time.perf_counter() - wall, time.process_time() - cpu)

    return run


@contextmanager
def _page(data: Any, size: int, events: int, tails: dict[str, list[float]]) -> Iterator[Contender]:
    from playwright.sync_api import Error, sync_playwright

    with wvr.view(data, open_browser=False) as viewer, sync_playwright() as api:
        path = next((found for name in CHROMIUM if (found := shutil.which(name)) is not None), None)
        try:
            browser = api.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        except Error as error:
            raise RuntimeError(f"no Chromium: {error}") from None
        # The panel is beside the picture, the line below it.
        page = browser.new_page(viewport={"width": max(size + 336, 720), "height": size + 32})
        page.set_default_timeout(120_000)
        page.goto(viewer.address)
        page.wait_for_selector(".wvr-met")

        def run() -> Time:
            cpu = time.process_time()
            seconds = page.evaluate(ANSWERS, events)
            tails.setdefault("first picture on a page", []).append(float(np.quantile(seconds, 0.95)))
            return Time(float(np.median(seconds)), (time.process_time() - cpu) / events)

        yield run
        browser.close()
