"""One client of a viewer: messages in, pictures and messages out, and the state between.

Messages are dictionaries with a ``type``; those of pointer, wheel, keys and size are rendercanvas's events.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..camera import Camera, image_size
from ..transfer_function import TransferFunction
from ..validation import choice, finite_vector
from . import cameras, edits
from .clips import Settings, clips_of, updated
from .describe import camera_json, source_json, state_json
from .handles import Floats, Handle, View, anchor_of, handles, overlay
from .history import History
from .loop import Loop
from .painter import Painter, Picture
from .pick import pick
from .pointer import ARROWS, Pointer, arrow, wheel
from .script import script
from .state import MOST_PIXELS, UNSEEN, Presentation, Source, State

Message = dict[str, Any]
# What undo goes back to.
Edited = tuple[TransferFunction | None, Settings]
# Steps to the right, upwards and away, of the keys of a handle; with shift they are a tenth.
STEPS = {
    "ArrowLeft": (-1, 0, 0), "ArrowRight": (1, 0, 0), "ArrowDown": (0, -1, 0), "ArrowUp": (0, 1, 0),
    "PageDown": (0, 0, -1), "PageUp": (0, 0, 1),
}  # fmt: skip
# What a client is sent: a message, and the picture that it is of.
Send = Callable[[Message, Picture | None], None]


class Grab(NamedTuple):
    """A handle that is held, as far from the pointer as it was taken, and the settings before."""

    handle: Handle
    offset: Floats
    cuts: Settings
    number: int


class Session:
    """A view of a source, which one client drives. It is painted from its first ``resize`` on.

    Parameters
    ----------
    source
        What there is to see.
    send
        Called with a message and, of type ``"picture"``, the picture; from any thread, and must not wait.
    """

    def __init__(self, source: Source, send: Send):
        self.source = source
        self._send = send
        self._pointer = Pointer()
        self._logical = (1, 1)
        self._grab: Grab | None = None
        self._grabs = 0
        self._history: History[Edited] = History()
        self._painter = Painter(source)
        self._loop: Loop[State, Any, Picture] = Loop(State(source.first), self._painter, self._show)

    @property
    def state(self) -> State:
        """The newest."""
        return self._loop.state

    def settle(self, timeout: float | None = None) -> bool:
        """Wait until the newest state is painted to the end; whether it is."""
        return self._loop.settle(timeout)

    def close(self) -> None:
        """End it; nothing is running any more when this returns."""
        self._loop.close()

    def greet(self) -> None:
        """Send what a client needs to know at first."""
        self._send(source_json(self.source), None)
        self._tell()

    def receive(self, message: Message) -> None:
        """Do what a message says; one that is wrong is answered by an error, and changes nothing."""
        try:
            kind = message.get("type") or message.get("event_type")
            handle = getattr(self, f"_on_{kind}", None) if isinstance(kind, str) else None
            if handle is not None:
                handle(message)
        except (ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError, OSError) as error:
            text = f"lacks {error}" if isinstance(error, KeyError) else str(error)
            self._send({"type": "error", "message": text}, None)

    # What changes, and who is told.

    def _show(self, number: int, picture: Picture | Exception) -> None:
        if isinstance(picture, Exception):
            text = str(picture) or type(picture).__name__
            self._send({"type": "error", "message": text, "number": number}, None)
            return
        image, presentation = picture.image, picture.state.presentation
        bound = image.max_error
        header = {
            "type": "picture",
            "number": number,
            "status": picture.status,
            "whole": picture.whole,
            "met": picture.met,
            "bound": bound if np.isfinite(bound) else None,
            "pixels": image.size,
            "size": presentation.size,
            "camera": camera_json(presentation.camera),
            "overlay": overlay(picture.state, self.source.first_volume.corners),
        }
        self._send(header, picture)

    def _tell(self) -> None:
        self._send(state_json(self.state, self._history), None)

    def _change(self, **fields: Any) -> None:
        """Of the presentation."""
        self._loop.change(lambda state: replace(state, presentation=replace(state.presentation, **fields)))

    def _move(self, move: Callable[[Camera], Camera]) -> None:
        """The camera that is the newest, elsewhere."""

        def update(state: State) -> State:
            camera = move(state.presentation.camera)
            return (
                state
                if camera is state.presentation.camera
                else replace(state, presentation=replace(state.presentation, camera=camera))
            )

        self._loop.change(update)

    @property
    def _presentation(self) -> Presentation:
        return self.state.presentation

    # Pointer, wheel, keys, size: events of rendercanvas.

    def _on_resize(self, message: Message) -> None:
        self._logical = width, height = max(int(message["width"]), 1), max(int(message["height"]), 1)
        ratio = min(max(float(message.get("pixel_ratio", 1.0)), 0.1), (MOST_PIXELS / (width * height)) ** 0.5)
        size = image_size((max(round(width * ratio), 1), max(round(height * ratio), 1)))
        first = self._presentation.size == UNSEEN
        self._change(size=size)
        if first and self.source.framed:
            self._on_view({"name": "reset"})

    def _on_pointer_down(self, message: Message) -> None:
        self._pointer.press(message)

    def _on_pointer_up(self, message: Message) -> None:
        self._pointer.release()

    def _on_pointer_move(self, message: Message) -> None:
        if self._pointer.down:
            self._move(lambda camera: self._pointer.move(camera, message, self._logical))
            return
        x, y = self._pixel(message)
        found = pick(self.source.loaded(self._presentation.frame), self._presentation, x, y)
        self._send({"type": "picked"} | ({} if found is None else found._asdict()), None)

    def _on_wheel(self, message: Message) -> None:
        self._move(lambda camera: wheel(camera, message))

    def _on_key_down(self, message: Message) -> None:
        key = message["key"]
        modifiers = set(message.get("modifiers", ()))
        if key in ARROWS:
            self._move(lambda camera: arrow(camera, key, "Shift" in modifiers, self._logical))
        elif key in ("+", "=", "-"):
            self._move(lambda camera: cameras.zoomed(camera, -1 if key == "-" else 1))
        elif key in ("r", "v"):
            self._on_view({"name": "reset" if key == "r" else "iso"})
        elif key in ("w", "s"):
            self._on_marks({"outline": key == "w"})
        elif key == "b":
            self._on_marks({"bound": not self.state.bound})
        elif key == "f":
            self._on_focus(message)
        elif key == "C":
            self._on_camera(message)

    def _pixel(self, message: Message) -> tuple[float, float]:
        """Where an event is in the picture."""
        size = self._presentation.size
        x, y = (float(message[axis]) * size[i] / self._logical[i] - 0.5 for i, axis in enumerate("xy"))
        return x, y

    # What the panel says.

    def _on_view(self, message: Message) -> None:
        presentation = self._presentation
        volume, labels = self.source.volume(presentation.frame), self.source.segmentation
        camera = cameras.viewed(message["name"], volume, presentation, labels, self.source.call.integrator)
        self._change(camera=camera)
        self._tell()

    def _on_focus(self, message: Message) -> None:
        """Turn around what is at a place of the picture, in the middle where there is none."""
        x, y = self._pixel(message) if "x" in message else (n / 2 for n in self._presentation.size)
        found = pick(self.source.loaded(self._presentation.frame), self._presentation, x, y)
        if found is not None:
            self._move(lambda camera: cameras.focused(camera, found.position))

    def _on_parallel(self, message: Message) -> None:
        self._move(lambda camera: cameras.projected(camera, bool(message["on"])))
        self._tell()

    def _on_edit(self, message: Message) -> None:
        tf = self._presentation.transfer_function
        if tf is None:
            raise ValueError("transfer functions of labels are not edited here")
        edited = edits.edited(tf, message, self.source)
        self._history.note(self._edited, message.get("drag"))
        self._change(transfer_function=edited)
        self._tell()

    def _on_clip(self, message: Message) -> None:
        self._cut(updated(self.state.cuts, message["kind"], message["set"]), drag=message.get("drag"))

    def _on_facing(self, message: Message) -> None:
        """The plane faces the camera: what is nearer than its middle is cut away."""
        forward = self._presentation.camera.basis()[2]
        self._cut(updated(self.state.cuts, "plane", {"on": True, "normal": forward.tolist()}))

    def _cut(self, cuts: Settings, anchor: tuple[float, ...] | None = None, drag: Any = None) -> None:
        """Other clips, which undo takes back."""
        before = self._edited
        self._become(cuts, anchor)
        self._history.note(before, drag)
        self._tell()

    def _become(self, cuts: Settings, anchor: tuple[float, ...] | None = None, **fields: Any) -> None:
        """Other clips, and fields of the presentation."""
        fields["clips"] = (*self.source.clips, *clips_of(cuts, self.source.first_volume.corners))
        self._loop.change(
            lambda state: replace(state, presentation=replace(state.presentation, **fields), cuts=cuts, anchor=anchor)
        )

    @property
    def _edited(self) -> Edited:
        return self._presentation.transfer_function, self.state.cuts

    # Handles in the picture: their places are parts of its width and height.

    def _handle(self, name: str) -> Handle:
        found = {handle.name: handle for handle in handles(self.state, self.source.first_volume.corners)}
        return found[choice(name, "handle", tuple(found))]

    def _place(self, message: Message) -> Floats:
        return finite_vector([*message["at"], 0.0], "at", "a place")[:2] * self._presentation.size - 0.5

    def _on_grab(self, message: Message) -> None:
        handle, view = self._handle(message["handle"]), View(self._presentation.camera, self._presentation.size)
        self._grabs += 1
        self._grab = Grab(handle, view.place(handle.position) - self._place(message), self.state.cuts, self._grabs)
        if handle.kind == "plane":
            anchor = tuple(anchor_of(self.state, self.source.first_volume.corners).tolist())
            self._loop.change(lambda state: replace(state, anchor=anchor))

    def _on_pull(self, message: Message) -> None:
        if self._grab is not None:
            handle, offset, cuts, number = self._grab
            changes = handle.pull(
                View(self._presentation.camera, self._presentation.size), self._place(message) + offset
            )
            self._cut(updated(cuts, handle.kind, changes), self.state.anchor, ("handle", number))

    def _on_drop(self, message: Message) -> None:
        self._grab = None
        self._loop.change(lambda state: replace(state, anchor=None))

    def _on_nudge(self, message: Message) -> None:
        handle = self._handle(message["handle"])
        steps = np.array(STEPS[choice(message["key"], "key", tuple(STEPS))]) * (0.1 if message.get("fine") else 1.0)
        changes = handle.nudge(View(self._presentation.camera, self._presentation.size), steps)
        self._cut(updated(self.state.cuts, handle.kind, changes), drag=("nudge", handle.name))

    def _on_undo(self, message: Message) -> None:
        self._step(self._history.undo)

    def _on_redo(self, message: Message) -> None:
        self._step(self._history.redo)

    def _step(self, step: Callable[[Edited], Edited]) -> None:
        tf, cuts = step(self._edited)
        self._become(cuts, transfer_function=tf)
        self._tell()

    def _on_light(self, message: Message) -> None:
        fields: Message = {}
        for name in ("lighting", "shadows"):
            if name in message:
                fields[name] = (getattr(self.source.first, name) or True) if message[name] else False
        if "lamp" in message:
            lamp = message["lamp"]
            fields["lamp"] = None if lamp is None else (float(lamp[0]), float(lamp[1]))
        self._change(**fields)
        self._tell()

    def _on_frame(self, message: Message) -> None:
        frame = int(message["index"])
        if not 0 <= frame < len(self.source.given_volumes):
            raise IndexError(f"frame must be from 0 to {len(self.source.given_volumes) - 1}, got {frame}")
        self._change(frame=frame)
        self._tell()

    def _on_marks(self, message: Message) -> None:
        self._loop.change(
            lambda state: replace(
                state,
                bound=bool(message.get("bound", state.bound)),
                outline=bool(message.get("outline", state.outline)),
            )
        )
        self._tell()

    # What is asked for.

    def _on_camera(self, message: Message) -> None:
        self._send({"type": "text", "title": "Camera", "text": f"wvr.{self._presentation.camera!r}"}, None)

    def _on_script(self, message: Message) -> None:
        text = script(self.source, self._presentation, self._painter.tolerance)
        self._send({"type": "text", "title": "Python", "text": text}, None)

    def _on_restore(self, message: Message) -> None:
        """All that a client had before its connection was lost, as it was last told."""
        known = message["state"]
        camera = Camera(**known["camera"])
        fields: Message = {
            "camera": camera,
            "frame": min(max(int(known["frame"]), 0), len(self.source.given_volumes) - 1),
        }
        if known["function"] is not None and self._presentation.transfer_function is not None:
            fields["transfer_function"] = TransferFunction.from_json(known["function"])
        cuts = self.state.cuts
        for kind, changes in known["clips"].items():
            cuts = updated(cuts, kind, changes)
        self._become(cuts, **fields)
        light = {name: known[name] for name in ("lighting", "shadows", *(("lamp",) if known["placed"] else ()))}
        self._on_light(light)
        self._on_marks(known)
