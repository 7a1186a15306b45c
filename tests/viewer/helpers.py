"""A small scene to view, and a client that keeps what it is sent."""

from __future__ import annotations

import time

import wvr
from wvr.defaults import Call
from wvr.viewer.session import Session
from wvr.viewer.state import Source


def source(**options) -> Source:
    """A volume that renders at once."""
    look = ("lighting", "shadows", "clip", "segmentation", "background")
    call = {name: options.pop(name) for name in look if name in options}
    volume = wvr.datasets.load("blobs", 24)
    lo, hi = volume.range
    tf = wvr.TransferFunction([(lo, "navy", 0.0), ((lo + hi) / 2, "orange", 0.2), (hi, "white", 0.6)])
    camera = wvr.Camera.fit(volume, direction=(1, 0.6, 0.4))
    return Source([volume], Call(tf, camera, **call), options)


class Client:
    """A session whose messages are kept."""

    def __init__(self, view: Source, size=(64, 48)):
        self.messages: list[dict] = []
        self.pictures = []
        self.session = Session(view, self.send)
        self.say("resize", width=size[0], height=size[1], pixel_ratio=1.0)

    def send(self, message, picture):
        self.messages.append(message)
        if picture is not None:
            self.pictures.append(picture)

    def say(self, kind, /, **fields):
        self.session.receive({"type": kind, **fields})

    def last(self, kind):
        """The last message of a kind."""
        return [message for message in self.messages if message["type"] == kind][-1]

    @property
    def errors(self):
        return [message["message"] for message in self.messages if message["type"] == "error"]

    def final(self):
        """The final picture of the state as it is."""
        assert self.session.settle(60)
        return self.pictures[-1]

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.session.close()


def wait_for(what, seconds=60.0):
    """Until it is true."""
    end = time.monotonic() + seconds
    while not (found := what()) and time.monotonic() < end:
        time.sleep(0.01)
    assert found
    return found
