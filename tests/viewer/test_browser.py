"""The page in a real browser, without a window. Skipped where there is no Chromium."""

from __future__ import annotations

import base64
import json
import shutil
import threading
import time
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

import wvr
from tests.viewer.helpers import source, wait_for

pytest.importorskip("websockets")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

from wvr.viewer import Viewer  # noqa: E402

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
TOKEN = "a-token-for-tests"
# The last picture, and what the canvas has, to the last bit.
SHOWN = """() => [window.pictures.at(-1),
  document.querySelector('canvas.wvr-picture').toDataURL('image/png').split(',')[1]]"""
WIDE = """() => [...document.querySelectorAll('.wvr-viewer *')]
  .filter((element) => element.getBoundingClientRect().right > innerWidth + 1)
  .map((element) => element.outerHTML.slice(0, 80))"""
NAMELESS = """() => [...document.querySelectorAll('button, input, select, [tabindex="0"]')]
  .filter((element) => element.checkVisibility())
  .filter((element) => !element.getAttribute('aria-label') && !element.textContent.trim())
  .filter((element) => !element.labels?.[0]?.textContent.trim())
  .map((element) => element.outerHTML)"""


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as api:
        found = next((path for name in NAMES if (path := shutil.which(name)) is not None), None)
        try:
            chromium = api.chromium.launch(executable_path=found, args=["--no-sandbox", "--disable-gpu"])
        except playwright.Error as error:
            pytest.skip(f"no Chromium: {str(error).splitlines()[0]}")
        yield chromium
        chromium.close()


@pytest.fixture
def viewer():
    with Viewer(source(), token=TOKEN) as opened:
        yield opened


@pytest.fixture
def lit():
    with Viewer(source(lighting=True), token=TOKEN) as opened:
        yield opened


class Page:
    """A page that complains of nothing."""

    def __init__(self, browser, viewer, width=400, height=300, **options):
        self.context = browser.new_context(viewport={"width": width, "height": height}, **options)
        self.page = self.context.new_page()
        self.page.set_default_timeout(60_000)
        self.problems: list[str] = []
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on("console", lambda said: said.type == "error" and self.problems.append(said.text))
        self.page.add_init_script(
            "window.pictures = []; document.addEventListener('DOMContentLoaded', () => {"
            "document.getElementById('viewer')"
            ".addEventListener('wvr-picture', (event) => pictures.push(event.detail))})"
        )
        self.page.goto(viewer.address)

    def pixels(self):
        """Of the final picture: after it comes no other, of a later movement of the mouse."""
        number = None
        while True:
            self.until("window.pictures.at(-1)?.whole && window.pictures.at(-1).met")
            message, image = self.page.evaluate(SHOWN)
            if message["whole"] and message["number"] == number:
                return np.array(Image.open(BytesIO(base64.b64decode(image))))
            number = message["number"]
            self.page.wait_for_timeout(100)

    def until(self, expression):
        """Until it is true; the page's policy lets nobody else look."""
        end = time.monotonic() + 60
        while not self.page.evaluate(expression):
            assert time.monotonic() < end, expression
            self.page.wait_for_timeout(20)

    def last(self):
        return self.page.evaluate("window.pictures.at(-1)")

    def changed(self, action):
        """The final picture after something is done."""
        self.pixels()
        before = self.last()["number"]
        action()
        self.until(f"window.pictures.at(-1).number > {before} && window.pictures.at(-1).whole")
        return self.pixels()

    def __enter__(self):
        return self

    def __exit__(self, kind, *error):
        self.context.close()
        if kind is None:
            assert not self.problems


def still(viewer, message):
    first = viewer._server._source.first
    camera = wvr.Camera(**message["camera"])
    volume = viewer._server._source.first_volume
    size = tuple(message["size"])
    return wvr.render(volume, first.transfer_function, camera, size, lighting=True).to_uint8("black")


def test_the_final_picture_is_the_still(browser, lit):
    """Every pixel of it, before and after a drag; and the page says that the tolerance is met."""
    with Page(browser, lit) as page:
        pixels = page.pixels()
        assert np.array_equal(pixels[..., :3], still(lit, page.last())) and np.all(pixels[..., 3] == 255)
        box = page.page.locator("canvas.wvr-picture").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

        def drag():
            page.page.mouse.move(x, y)
            page.page.mouse.down()
            page.page.mouse.move(x + 40, y + 15, steps=5)
            page.page.mouse.up()

        turned = page.changed(drag)
        assert not np.array_equal(turned, pixels)
        assert np.array_equal(turned[..., :3], still(lit, page.last()))
        numbers = page.page.evaluate("window.pictures.map((picture) => picture.number)")
        assert numbers == sorted(numbers)
        text = page.page.inner_text(".wvr-status")
        assert "within the tolerance" in text and "but for light" in text
        assert page.page.locator("[role=status]").inner_text() == text
        page.page.mouse.move(x, y)
        page.until("document.querySelector('.wvr-under').textContent.includes('at (')")
        page.page.wait_for_timeout(200)
        assert page.page.inner_text(".wvr-status") == text, "what is under the mouse changes no picture"


def test_wheel_and_keys(browser, viewer):
    with Page(browser, viewer) as page:
        page.pixels()
        canvas = page.page.locator("canvas.wvr-picture")
        canvas.focus()
        far = page.last()["camera"]
        page.changed(lambda: page.page.keyboard.press("+"))
        near = page.last()["camera"]
        target = np.array(far["target"])
        assert np.linalg.norm(near["position"] - target) < np.linalg.norm(far["position"] - target)
        canvas.hover()
        page.changed(lambda: page.page.mouse.wheel(0, 100))
        assert np.allclose(page.last()["camera"]["position"], far["position"])
        page.changed(lambda: page.page.keyboard.press("ArrowLeft"))
        bounds = page.changed(lambda: page.page.keyboard.press("b"))
        assert page.page.get_by_label("Error bound").is_checked() and bounds[..., :3].any()
        page.page.keyboard.press("?")
        assert page.page.get_by_role("dialog").get_by_text("turn around what is under the mouse").is_visible()
        page.page.keyboard.press("Escape")
        with page.page.expect_download() as download:
            page.page.keyboard.press("S")
        assert download.value.suggested_filename == "wvr.png"


def test_the_editor_changes_the_picture(browser, viewer):
    """By mouse, by keys and by numbers; undo brings it back."""
    with Page(browser, viewer, height=400) as page:
        first = page.pixels()
        handle = page.page.get_by_role("slider", name="Control point 2")
        handle.scroll_into_view_if_needed()
        box = handle.bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

        def drag():
            page.page.mouse.move(x, y)
            page.page.mouse.down()
            page.page.mouse.move(x + 10, y - 20, steps=4)
            page.page.mouse.up()

        dragged = page.changed(drag)
        assert not np.array_equal(dragged, first)
        undo = page.page.get_by_role("button", name="Undo")
        assert np.array_equal(page.changed(undo.click), first), "a drag is undone as a whole"
        assert not undo.is_enabled()
        opacity = page.page.get_by_label("Opacity")

        def typed():
            handle.focus()
            opacity.fill("0.55")
            opacity.press("Enter")

        page.changed(typed)
        assert handle.get_attribute("aria-valuenow") == "0.55"
        handle.focus()
        page.changed(lambda: handle.press("ArrowDown"))
        assert float(handle.get_attribute("aria-valuenow")) < 0.55
        page.changed(lambda: page.page.get_by_label("Colour").fill("#00ff00"))
        page.changed(lambda: page.page.get_by_label("Function").select_option("viridis"))
        with page.page.expect_download() as download:
            page.page.get_by_role("button", name="Save", exact=True).click()
        tf = wvr.TransferFunction.load(download.value.path().rename(download.value.path().with_suffix(".json")))
        assert len(tf.knots) > 100
        with page.page.expect_file_chooser() as chooser:
            page.page.get_by_role("button", name="Load").click()
        text = viewer._server._source.first.transfer_function.to_json()
        file = {"name": "tf.json", "mimeType": "application/json", "buffer": text.encode()}
        assert np.array_equal(page.changed(lambda: chooser.value.set_files(file)), first)
        chooser.value.set_files(file | {"buffer": b"no"})
        page.page.get_by_role("alert").get_by_text("not a JSON file").wait_for()


def test_light(browser, lit):
    with Page(browser, lit, height=400) as page:
        first = page.pixels()
        moved = page.changed(lambda: page.page.get_by_label("From the right").fill("80"))
        assert not np.array_equal(moved, first)
        assert np.array_equal(page.changed(page.page.get_by_role("button", name="As at first").click), first)
        page.changed(page.page.get_by_label("Shadows").click)
        page.changed(page.page.get_by_label("Shadows").click)


def test_clips_and_the_script(browser, viewer):
    with Page(browser, viewer, height=400) as page:
        page.page.get_by_text("Clip", exact=True).click()
        page.changed(page.page.get_by_label("Cut by a plane").click)
        page.changed(lambda: page.page.get_by_label("Plane at").fill("0.3"))
        page.changed(page.page.get_by_role("button", name="Facing me").click)
        page.changed(page.page.get_by_label("Cut by a plane").click)
        page.page.get_by_role("button", name="Copy as Python").click()
        page.until("document.querySelector('dialog textarea').value !== ''")
        script = page.page.get_by_label("Text").input_value()
        assert script.startswith("import wvr") and "wvr.render(" in script


def test_handles_of_clips(browser, viewer):
    """By mouse and by keys; the picture follows while they are held, and control and Z undoes a drag."""
    with Page(browser, viewer, width=760, height=420) as page:
        page.page.get_by_text("Clip", exact=True).click()
        for kind in ("sphere", "plane"):
            page.changed(page.page.get_by_label(f"Cut by a {kind}").click)
        first = page.changed(lambda: page.page.get_by_label("Plane at").fill("0.2"))  # not where the ball's centre is
        names = page.page.locator(".wvr-handle").evaluate_all("all => all.map((one) => one.ariaLabel)")
        assert names == ["Tilt the plane", "Move the plane", "Radius of the sphere", "Move the sphere"]
        handle = page.page.get_by_role("slider", name="Move the plane")
        box = handle.bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        seen = len(page.page.evaluate("window.pictures"))

        def drag():
            page.page.mouse.move(x, y)
            page.page.mouse.down()
            for step in range(4):
                page.page.mouse.move(x - 3 * step, y - 3 * step)
                page.until(f"window.pictures.length > {seen + step}")
            assert page.page.evaluate(f"window.pictures.slice({seen}).some((one) => !one.whole)"), "coarse while held"
            page.page.mouse.up()

        dragged = page.changed(drag)
        assert not np.array_equal(dragged, first)
        clips = page.page.evaluate("window.pictures.at(-1).overlay.handles.map((one) => one.at)")
        now = handle.bounding_box()
        left, top, width, height = page.page.locator(".wvr-overlay").bounding_box().values()
        center = (now["x"] + now["width"] / 2 - left) / width, (now["y"] + now["height"] / 2 - top) / height
        assert center == pytest.approx(clips[1], abs=2e-3), "it is drawn where it is"
        assert page.page.evaluate("document.activeElement.ariaLabel") == "Move the plane"
        assert np.array_equal(page.changed(lambda: page.page.keyboard.press("Control+z")), first)
        assert np.array_equal(page.changed(lambda: page.page.keyboard.press("Control+Shift+z")), dragged)
        before = float(handle.get_attribute("aria-valuenow"))
        page.changed(lambda: handle.press("ArrowDown"))
        assert float(handle.get_attribute("aria-valuenow")) == pytest.approx(before - 0.01, abs=1e-4)
        page.page.get_by_label("Handles in the picture").click()
        assert not page.page.locator(".wvr-overlay").is_visible()


def test_two_pages(browser, viewer):
    with Page(browser, viewer) as one, Page(browser, viewer, width=390, height=600) as other:
        one.pixels()
        before = other.pixels()
        assert viewer.clients == 2
        one.page.locator("canvas.wvr-picture").focus()
        one.changed(lambda: one.page.keyboard.press("ArrowLeft"))
        assert np.array_equal(other.pixels(), before)
        assert before.shape[1] == 390, "the picture is as wide as the screen"


def test_a_page_finds_a_viewer_that_was_started_again(browser):
    """With its camera, transfer function and clips."""
    first = Viewer(source(), token=TOKEN)
    with Page(browser, first, height=400) as page:
        page.pixels()
        page.page.locator("canvas.wvr-picture").focus()
        page.changed(lambda: page.page.keyboard.press("ArrowLeft"))
        handle = page.page.get_by_role("slider", name="Control point 2")
        handle.focus()
        shown = page.changed(lambda: handle.press("ArrowUp"))
        port = first._server.port
        first.close()
        page.page.get_by_role("alert").get_by_text("No connection").wait_for()
        page.page.evaluate("window.pictures = []")
        with Viewer(source(), port, TOKEN) as viewer:
            # As one that comes back from the browser's history would, beside the one that tries again.
            page.page.evaluate("dispatchEvent(new PageTransitionEvent('pageshow', { persisted: true }))")
            again = page.pixels()
            assert np.array_equal(again, shown)
            page.page.evaluate("dispatchEvent(new PageTransitionEvent('pageshow', { persisted: true }))")
            page.changed(lambda: page.page.keyboard.press("ArrowUp"))
            assert viewer.clients == 1
        page.problems = [problem for problem in page.problems if "WebSocket" not in problem]


def test_closing_a_tab_frees_everything(browser, viewer):
    before = {thread for thread in threading.enumerate() if thread.name.startswith("wvr")}
    with Page(browser, viewer) as page:
        page.until("window.pictures.length > 0")
        assert viewer.clients == 1
    wait_for(lambda: viewer.clients == 0)
    wait_for(lambda: {thread for thread in threading.enumerate() if thread.name.startswith("wvr")} <= before)


@pytest.mark.parametrize("width", [390, 1000])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_everything_has_a_name_and_fits(browser, viewer, width, scheme):
    """Each control has a name for those who do not see it; nothing is wider than the screen; text stands out."""
    with Page(browser, viewer, width, 844, color_scheme=scheme) as page:
        page.until("window.pictures.length > 0")
        page.page.evaluate("document.querySelectorAll('details').forEach((details) => { details.open = true })")
        assert page.page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.page.evaluate(WIDE) == [] and page.page.evaluate(NAMELESS) == []
        assert contrast(page.page, ".wvr-status") > 4.5 and contrast(page.page, ".wvr-note") > 4.5
        assert page.page.evaluate("document.documentElement.lang") == "en"
        page.page.keyboard.press("Tab")
        assert page.page.evaluate("document.activeElement.className") == "wvr-picture"


def contrast(page, selector):
    """Of a text and what is behind it, as the Web Content Accessibility Guidelines define it."""
    colors = page.evaluate(
        f"""() => {{
          const element = document.querySelector('{selector}')
          let behind = element
          while (getComputedStyle(behind).backgroundColor === 'rgba(0, 0, 0, 0)') behind = behind.parentElement
          return [getComputedStyle(element).color, getComputedStyle(behind).backgroundColor]
        }}"""
    )
    lights = []
    for color in colors:
        rgb = np.array(json.loads(f"[{color[color.index('(') + 1 : -1]}]")[:3]) / 255
        lights.append(float(wvr.color.srgb_to_linear(rgb) @ (0.2126, 0.7152, 0.0722)))
    return (max(lights) + 0.05) / (min(lights) + 0.05)


def test_time(browser):
    volumes = [wvr.datasets.load("blobs", n) for n in (16, 20)]
    with (
        wvr.view(volumes, "viridis", opacity="linear", open_browser=False) as viewer,
        Page(browser, viewer) as page,
    ):
        first = page.pixels()
        later = page.changed(lambda: page.page.get_by_label("Time").fill("1"))
        assert not np.array_equal(first, later)


def test_the_widget_has_handles(browser, monkeypatch):
    """The front end of notebooks, with a kernel that is here."""
    pytest.importorskip("anywidget")
    from wvr.viewer.widget import Widget, front_end

    sent = []
    monkeypatch.setattr(Widget, "send", lambda self, content, buffers=None: sent.append((content, buffers)))
    widget, context = Widget(source()), browser.new_context(viewport={"width": 900, "height": 600})
    try:
        page = context.new_page()
        page.expose_function("tell", lambda message: widget._receive(widget, message, []))
        page.set_content("<div id='cell'></div>")
        page.add_style_tag(content=widget._css)
        page.add_script_tag(type="module", content=front_end().replace("export default", "window.made ="))
        page.wait_for_function("window.made")
        page.evaluate(
            "made.render({ el: document.getElementById('cell'), model: { send: tell, get: () => '',"
            " on: (_, receive) => { window.receive = receive }, off: () => {} } })"
        )

        def until(found):
            end = time.monotonic() + 60
            while not found():
                assert time.monotonic() < end
                while sent:
                    content, buffers = sent.pop(0)
                    png = [base64.b64encode(one).decode() for one in buffers or ()]
                    page.evaluate(
                        "([message, all]) => receive(message,"
                        " all.map((one) => Uint8Array.from(atob(one), (letter) => letter.charCodeAt(0))))",
                        [content, png],
                    )
                page.wait_for_timeout(20)

        until(lambda: page.locator(".wvr-met").count())
        page.get_by_text("Clip", exact=True).click()
        page.get_by_label("Cut by a plane").click()
        handle = page.locator("[data-name='plane at']")
        until(handle.count)
        box = handle.bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x - 20, y - 10)
        page.mouse.up()
        until(lambda: widget.session.state.cuts["plane"]["at"] != 0.5)
    finally:
        context.close()
        widget.close()
