"""The page's server: who may come in, how much they may say, and that nothing is left of those who went."""

from __future__ import annotations

import json
import struct
import threading
import urllib.error
import urllib.request
from contextlib import ExitStack, suppress
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

import wvr
from tests.viewer.helpers import source, wait_for

pytest.importorskip("websockets")

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from wvr.viewer import Viewer
from wvr.viewer import server as serving
from wvr.viewer.outbox import UNSEEN
from wvr.viewer.page import resource

TOKEN = "a-token-for-tests"


@pytest.fixture
def viewer():
    with Viewer(source(), token=TOKEN) as opened:
        yield opened


class Tab:
    """What a page does, without a browser."""

    def __init__(self, viewer, size=(32, 24), seen=True, **options):
        self.stack = ExitStack()
        address = viewer.address.replace("http", "ws") + "socket"
        self.socket = self.stack.enter_context(connect(address, proxy=None, **options))
        self.seen = seen
        with suppress(ConnectionClosed):
            self.say("resize", width=size[0], height=size[1], pixel_ratio=1)

    def say(self, kind, /, **fields):
        self.socket.send(json.dumps({"type": kind, **fields}))

    def next(self, timeout=20):
        """A message, and the pixels that come with it."""
        received = self.socket.recv(timeout)
        if isinstance(received, str):
            return json.loads(received), None
        (length,) = struct.unpack(">I", received[:4])
        if self.seen:
            self.say("seen")
        return json.loads(received[4 : 4 + length]), np.array(Image.open(BytesIO(received[4 + length :])))

    def until(self, accepted):
        while True:
            message, pixels = self.next()
            if accepted(message):
                return message, pixels

    def final(self):
        return self.until(lambda message: message["type"] == "picture" and message["whole"])

    def closing(self):
        """The code and reason it is closed with."""
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                self.next()
        return closed.value.rcvd.code, closed.value.rcvd.reason

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.stack.close()


def get(address, **headers):
    """Status, headers and text."""
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(urllib.request.Request(address, headers=headers), timeout=10) as response:
            return response.status, response.headers, response.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read().decode()


@pytest.mark.parametrize("name", serving.PAGE)
def test_files_of_the_page(viewer, name):
    status, headers, text = get(viewer.address + name)
    assert status == 200 and text == resource(serving.PAGE[name][0])
    assert headers.get_content_type() == serving.PAGE[name][1]
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert headers["Referrer-Policy"] == "no-referrer" and headers["X-Content-Type-Options"] == "nosniff"


@pytest.mark.parametrize(
    "path", ["", "wrong-token-here/", "wrong-token-here/socket", f"{TOKEN}x/", f"{TOKEN}/../view.py"]
)
def test_without_the_token_there_is_nothing(viewer, path):
    root = viewer.address.removesuffix(f"{TOKEN}/")
    status, _, text = get(root + path)
    assert status == 404 and TOKEN not in text
    with pytest.raises(InvalidStatus):
        connect(root.replace("http", "ws") + path, proxy=None)


def test_tokens_are_not_guessed(viewer):
    with Viewer(source()) as a, Viewer(source()) as b:
        tokens = {one.address.split("/")[3] for one in (a, b)}
    assert len(tokens) == 2 and all(len(token) >= 32 for token in tokens)


def test_only_this_machine_is_served(viewer):
    assert viewer.address.startswith("http://127.0.0.1:")
    assert viewer._server.bound == {"127.0.0.1"}


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "0.0.0.0"])
def test_other_names_are_refused(viewer, host):
    """A name that somebody else's DNS says is this machine."""
    assert get(viewer.address, Host=host)[0] == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "http://localhost"])
def test_pages_from_elsewhere_cannot_connect(viewer, origin):
    """Even those that know the token."""
    with pytest.raises(InvalidStatus) as refused:
        Tab(viewer, origin=origin)
    assert refused.value.response.status_code == 403
    assert viewer.clients == 0


def test_pictures_come_as_they_are(viewer):
    with Tab(viewer, origin=viewer.address.removesuffix(f"/{TOKEN}/")) as tab:
        message, pixels = tab.final()
        scene = viewer._server._source.first
        camera = wvr.Camera(**message["camera"])
        image = wvr.render(viewer._server._source.first_volume, scene.transfer_function, camera, (32, 24))
        assert np.array_equal(pixels, image.to_uint8("black"))
        assert message["met"] and message["bound"] == image.max_error


def test_clients_have_views_of_their_own(viewer):
    with Tab(viewer) as one, Tab(viewer, size=(40, 20)) as other:
        before, _ = other.final()
        one.final()
        assert viewer.clients == 2
        one.say("key_down", key="ArrowLeft", modifiers=[])
        turned, _ = one.final()
        assert turned["camera"] != before["camera"] and turned["pixels"] == [32, 24]
        other.say("marks", outline=True)
        after, _ = other.final()
        assert after["camera"] == before["camera"] and after["pixels"] == [40, 20]


def test_no_more_clients_than_there_may_be(viewer, monkeypatch):
    monkeypatch.setattr(serving, "MOST_CLIENTS", 2)
    with Tab(viewer), Tab(viewer):
        wait_for(lambda: viewer.clients == 2)
        with Tab(viewer) as third:
            assert third.closing()[0] == 1013
    wait_for(lambda: viewer.clients == 0)
    with Tab(viewer) as again:
        again.final()


def test_too_many_messages_end_a_connection(viewer, monkeypatch):
    monkeypatch.setattr(serving, "BURST", 50.0)
    monkeypatch.setattr(serving, "RATE", 1.0)
    with Tab(viewer) as tab, Tab(viewer) as other:
        with suppress(ConnectionClosed):
            for _ in range(60):
                tab.say("unknown")
        code, reason = tab.closing()
        assert code == 1008 and "messages a second" in reason
        other.final()


def test_an_allowance_grows_again(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr(serving, "monotonic", lambda: clock[0])
    allowance = serving.Allowance()
    assert sum(allowance.take() for _ in range(10_000)) == serving.BURST
    clock[0] = 1.0
    assert sum(allowance.take() for _ in range(10_000)) == serving.RATE


@pytest.mark.parametrize(
    ("text", "code"), [("no json", 1003), ("[1]", 1003), ("[" * 100_000, 1003), ("x" * 2**18, 1009)]
)
def test_what_is_no_message_ends_a_connection(viewer, text, code):
    with Tab(viewer) as tab:
        with suppress(ConnectionClosed):
            tab.socket.send(text + " ")
        assert tab.closing()[0] == code
    with Tab(viewer) as other:
        other.final()


def test_a_message_that_cannot_be_sent_ends_a_connection(viewer):
    """Open and mute, it would look as if nothing happened any more."""
    with Tab(viewer) as tab:
        tab.final()
        next(iter(viewer._server._sessions))._send({"type": "picked", "value": float("nan")}, None)
        code, reason = tab.closing()
        assert code == 1011 and "could not be sent" in reason
    wait_for(lambda: viewer.clients == 0)
    with Tab(viewer) as other:
        other.final()


def test_a_client_that_does_not_look_is_not_sent_old_pictures(viewer):
    with Tab(viewer, seen=False) as tab:
        for _ in range(UNSEEN):
            tab.until(lambda message: message["type"] == "picture")
        for _ in range(30):
            tab.say("key_down", key="ArrowLeft", modifiers=[])
        tab.say("camera")
        tab.until(lambda message: message["type"] == "text")
        with pytest.raises(TimeoutError):
            while True:
                message, _ = tab.next(timeout=0.5)
                assert message["type"] != "picture"
        # As it looks up, it has the last one.
        tab.seen = True
        for _ in range(UNSEEN):
            tab.say("seen")
        message, _ = tab.final()
        assert message["number"] >= 31


def threads():
    return {thread for thread in threading.enumerate() if thread.name.startswith("wvr")}


def test_a_closed_tab_leaves_nothing(viewer):
    before = threads()
    tab = Tab(viewer, size=(600, 600))
    tab.until(lambda message: message["type"] == "picture")
    session = next(iter(viewer._server._sessions))
    tab.socket.close()
    wait_for(lambda: viewer.clients == 0 and threads() <= before)
    assert not session._loop._thread.is_alive()


def test_a_closed_viewer_leaves_nothing():
    before = threads()
    viewer = Viewer(source())
    with Tab(viewer, size=(600, 600)) as tab:
        tab.until(lambda message: message["type"] == "picture")
        viewer.close()
        assert tab.closing()[0] == 1001
    wait_for(lambda: threads() <= before)
    assert repr(viewer) == "Viewer(closed)"
    viewer.close()
    with pytest.raises(OSError):
        connect(viewer.address.replace("http", "ws") + "socket", proxy=None)


def test_started_again_it_is_found_where_it_was():
    with Viewer(source(), token=TOKEN) as viewer:
        address, port = viewer.address, viewer._server.port
    with Viewer(source(), port, TOKEN) as again:
        assert again.address == address
        with Tab(again) as tab:
            tab.final()


def test_a_script_waits_until_pages_are_closed(monkeypatch):
    monkeypatch.setattr("wvr.viewer.viewer.GRACE", 0.3)
    viewer = Viewer(source())
    waiting = threading.Thread(target=viewer.wait)
    waiting.start()
    waiting.join(0.6)
    assert waiting.is_alive(), "nobody was there yet"
    with Tab(viewer) as tab:
        tab.final()
        waiting.join(0.5)
        assert waiting.is_alive()
    waiting.join(10)
    assert not waiting.is_alive() and not viewer._server.running


def test_a_port_that_is_taken_is_an_error(viewer):
    with pytest.raises(OSError, match=f"port {viewer._server.port} of 127.0.0.1 cannot be served"):
        Viewer(source(), viewer._server.port)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"port": -1}, ValueError, "port must be an integer from 0 to 65535, got -1"),
        ({"port": 1.5}, ValueError, "port must be"),
        ({"token": "short"}, ValueError, "token must be at least 16"),
        ({"token": "a/b" * 10}, ValueError, "token must be"),
        ({"size": (3, 3)}, TypeError, "view has no keyword 'size'"),
        ({"cmap": "viridis"}, TypeError, "view has no keyword 'cmap'; give the colour map"),
        ({"tolerance": 2}, ValueError, "tolerance"),
        ({"camera": "nowhere"}, ValueError, "camera must be"),
    ],
)
def test_wrong_arguments(blobs, arguments, error, message):
    with pytest.raises(error, match=message):
        wvr.view(blobs, open_browser=False, **arguments)


def test_view_opens_a_browser_and_says_where(blobs, monkeypatch, capsys):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr("sys.ps1", ">>> ", raising=False)
    with wvr.view([blobs, blobs], "viridis") as viewer:
        assert opened == [viewer.address] and viewer.address in capsys.readouterr().err
    with blobs.view("magma", open_browser=False, tolerance=1e-2) as viewer:
        assert viewer._server._source.options == {"tolerance": 1e-2}
