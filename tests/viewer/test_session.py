"""A client's session with a real, small scene."""

from __future__ import annotations

import json
import random
import threading

import numpy as np
import pytest

import wvr
from tests.viewer.helpers import Client, source, wait_for
from wvr.defaults import Call, studio
from wvr.integrators.base import Integrator
from wvr.viewer.describe import dumps
from wvr.viewer.script import NAMES
from wvr.viewer.state import Source, towards
from wvr.viewer.viewer import source_of


def still(client):
    """What wvr.render makes of the state."""
    scene = client.session.state.presentation
    lighting, shadows = scene.lights()
    return wvr.render(
        client.session.source.volume(scene.frame),
        scene.transfer_function,
        scene.camera,
        scene.size,
        lighting=lighting or False,
        shadows=shadows or False,
        clip=scene.clips,
        background=client.session.source.background,
        **client.session.source.options,
    )


def assert_still(client):
    """The final picture is that image to the last bit."""
    picture, image = client.final(), still(client)
    assert picture.whole
    assert np.array_equal(picture.image.rgba, image.rgba)
    assert np.array_equal(picture.pixels, image.to_uint8())
    if image.error_bound is not None:
        assert np.array_equal(picture.image.error_bound, image.error_bound)
    return picture


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"tolerance": 1e-3},
        {"integrator": wvr.Riemann(0.7)},
        {"lighting": True},
        {"lighting": True, "shadows": True},
    ],
    ids=str,
)
def test_final_pictures_are_stills(options):
    with Client(source(**options)) as client:
        client.say("pointer_down", x=10, y=10, button=1)
        for x in range(11, 30):
            client.say("pointer_move", x=x, y=10 + x / 3, button=1, modifiers=[])
        client.say("pointer_up")
        client.say("wheel", x=0, y=0, dx=0, dy=-150)
        picture = assert_still(client)
        assert picture.met == ("integrator" not in options)
        assert not client.errors


def test_status_says_pixels_and_bounds():
    with Client(source(tolerance=1e-3), size=(256, 200)) as client:
        client.final()
        texts = [message["status"] for message in client.messages if message["type"] == "picture"]
        assert "of 256 × 200 pixels, error not bounded yet" in texts[0]
        assert texts[-1].startswith("256 × 200 pixels, error ≤ ") and texts[-1].endswith("within the tolerance 0.001")
        last = client.last("picture")
        assert last["met"] and last["whole"] and 0 < last["bound"] <= 1e-3
        assert [picture.whole for picture in client.pictures[-2:]] == [False, True]
    with Client(source(lighting=True)) as client:
        assert "but for light" in client.final().status
    with Client(source(integrator=wvr.Riemann(1.0))) as client:
        assert client.final().status.endswith("error not bounded")


def test_random_events_end_in_the_still():
    """Of every kind, as fast as they come."""
    rng = random.Random(0)
    with Client(source(), size=(40, 30)) as client:
        low, high = client.session.source.first_volume.range

        def once():
            kind = rng.randrange(9)
            x, y = rng.uniform(0, 40), rng.uniform(0, 30)
            if kind == 0:
                client.say("pointer_down", x=x, y=y, button=rng.choice([1, 2, 3]))
            elif kind == 1:
                client.say("pointer_up")
            elif kind == 2:
                client.say("wheel", x=x, y=y, dx=0, dy=rng.uniform(-60, 60))
            elif kind == 3:
                client.say("key_down", key=rng.choice(["r", "v", "w", "s", "b", "f", "+", "-", "ArrowLeft", "q"]))
            elif kind == 4:
                client.say("edit", op="move", index=1, scalar=rng.uniform(low, high), opacity=rng.random() / 2)
            elif kind == 5:
                client.say("clip", kind="plane", set={"on": rng.random() < 0.5, "at": rng.random() / 2})
            elif kind == 6:
                client.say("resize", width=rng.randint(20, 50), height=rng.randint(20, 50), pixel_ratio=1)
            else:
                client.say("pointer_move", x=x, y=y, button=1, modifiers=[])

        for _ in range(300):
            once()
        assert not client.errors
        client.say("marks", bound=False, outline=False)
        client.say("view", name="reset")
        assert_still(client)
        numbers = [message["number"] for message in client.messages if message["type"] == "picture"]
        assert numbers == sorted(numbers)


def test_marks_need_no_new_rays():
    """The bound is drawn of the image that is there; so is the box."""
    with Client(source()) as client:
        first = client.final()
        client.say("key_down", key="b", modifiers=[])
        bounds = client.final()
        assert bounds.image is first.image and not np.array_equal(bounds.pixels, first.pixels)
        client.say("key_down", key="b", modifiers=[])
        client.say("key_down", key="w", modifiers=[])
        box = client.final()
        assert box.image is first.image
        changed = np.any(box.pixels != first.pixels, axis=2)
        assert 0 < changed.mean() < 0.4
        client.say("key_down", key="s", modifiers=[])
        assert np.array_equal(client.final().pixels, first.pixels)


def test_bounds_are_brighter_where_they_are_larger():
    with Client(source(tolerance=1e-3)) as client:
        client.say("marks", bound=True)
        picture = client.final()
        bound, light = picture.image.error_bound.ravel(), picture.pixels.sum(axis=2).ravel().astype(float)
        order = np.argsort(bound)
        assert np.all(np.diff(light[order]) >= -3), "magma is brighter the farther, to rounding"
        assert light[bound == 0].max(initial=0) <= light[order[-1]]


def test_the_editor_changes_the_picture_and_undo_brings_it_back():
    with Client(source()) as client:
        first = client.final()
        client.say("edit", op="move", index=1, scalar=0.5, opacity=0.9)
        edited = assert_still(client)
        assert not np.array_equal(edited.pixels, first.pixels)
        assert client.last("state")["history"] == (1, 0)
        client.say("undo")
        assert np.array_equal(client.final().image.rgba, first.image.rgba)
        client.say("redo")
        assert np.array_equal(client.final().image.rgba, edited.image.rgba)


@pytest.mark.parametrize("name", ["bands", "surfaces", "mri", "viridis"])
def test_functions_by_name(name):
    with Client(source()) as client:
        before = client.session.state.presentation.transfer_function
        client.say("edit", op="choose", name=name)
        after = client.session.state.presentation.transfer_function
        assert not client.errors and after != before
        if name == "viridis":
            s = np.linspace(*client.session.source.first_volume.range, 50)
            assert np.allclose(after.extinction(s), before.extinction(s)), "a colour map recolours what is there"
        assert_still(client)


def test_a_saved_function_loads_exactly(tmp_path):
    with Client(source()) as client:
        client.say("edit", op="move", index=1, scalar=0.1 + 0.2, opacity=1 / 3)
        text = client.last("state")["function"]
        (tmp_path / "tf.json").write_text(text)
        assert wvr.TransferFunction.load(tmp_path / "tf.json") == client.session.state.presentation.transfer_function
        client.say("undo")
        client.say("edit", op="load", text=text)
        assert client.session.state.presentation.transfer_function == wvr.TransferFunction.load(tmp_path / "tf.json")


def test_a_function_of_pyvista_that_is_loaded_has_a_length():
    """Views, colour maps and other edits need it as a number."""
    with Client(source(), size=(16, 12)) as client:
        volume, tf = client.session.source.first_volume, client.session.state.presentation.transfer_function
        client.say("edit", op="load", text=tf.per("pyvista").to_json())
        assert client.session.state.presentation.transfer_function == tf.per("pyvista").for_volume(volume)
        for name in ("iso", "reset"):
            client.say("view", name=name)
        client.say("edit", op="choose", name="viridis")
        assert not client.errors
        assert_still(client)


def test_shadows_without_lighting_are_those_of_the_lamp():
    with Client(source(lighting=False, shadows=True)) as client:
        scene = client.session.state.presentation
        (upper_left, _), color = studio(scene.camera).lights, (0.95, 0.95, 0.95)
        assert scene.lights() == (None, wvr.ConvolutionShadows(light=upper_left))
        before = assert_still(client)
        client.say("light", lamp=[40.0, -10.0])
        lamp = wvr.DirectionalLight(towards((40.0, -10.0), scene.camera), color)
        assert client.session.state.presentation.lights() == (None, wvr.ConvolutionShadows(light=lamp))
        assert not np.array_equal(assert_still(client).pixels, before.pixels)
        client.say("light", shadows=False)
        assert client.session.state.presentation.lights() == (None, None)


def test_light_follows_the_camera_until_it_is_placed():
    with Client(source(lighting=True)) as client:
        client.say("key_down", key="ArrowLeft", modifiers=[])
        assert_still(client)
        scene = client.session.state.presentation
        assert scene.lights()[0] == wvr.defaults.studio(scene.camera)
        client.session.greet()
        lamp = client.last("state")
        client.say("light", lamp=[40.0, -10.0])
        first = client.session.state.presentation.lights()[0].lights[0]
        right, up, forward = scene.camera.basis()
        direction = np.array(first.direction)
        assert np.isclose(np.degrees(np.arcsin(direction @ up)), -10)
        assert np.isclose(np.degrees(np.arctan2(direction @ right, -direction @ forward)), 40)
        client.say("light", shadows=True)
        assert_still(client)
        client.say("light", lighting=False, shadows=False)
        assert client.session.state.presentation.lights() == (None, None)
        assert lamp["lighting"] and not client.last("state")["lighting"]


def test_clips_cut():
    with Client(source()) as client:
        whole = client.final()
        seen = {}
        for kind, changes in {
            "plane": {"on": True, "normal": [0, 0, 1], "at": 0.5},
            "box": {"on": True, "lo": [0.2, 0.2, 0.2], "hi": [0.8, 0.8, 0.8]},
            "sphere": {"on": True, "radius": 0.3},
        }.items():
            client.say("clip", kind=kind, set=changes)
            seen[kind] = assert_still(client).image.rgba[..., 3].sum()
            client.say("clip", kind=kind, set={"invert": True})
            other = assert_still(client).image.rgba[..., 3].sum()
            assert seen[kind] < whole.image.rgba[..., 3].sum() and other != seen[kind]
            client.say("clip", kind=kind, set={"on": False})
        corners = client.session.source.first_volume.corners
        client.say("clip", kind="plane", set={"on": True, "invert": False})
        (plane,) = client.session.state.presentation.clips
        assert plane.keeps(corners).sum() == 4 and np.allclose(plane.point, corners.mean(axis=0))
        client.say("facing")
        (plane,) = client.session.state.presentation.clips
        assert np.allclose(plane.normal, client.session.state.presentation.camera.basis()[2])
        assert not client.errors


def test_clips_that_were_given_stay():
    given = wvr.ClipSphere((12, 12, 12), 9.0)
    with Client(source(clip=given)) as client:
        assert_still(client)
        client.say("clip", kind="plane", set={"on": True})
        assert client.session.state.presentation.clips[0] == given and len(client.session.state.presentation.clips) == 2
        assert_still(client)


def test_picking_finds_a_wall():
    """Of a step from nothing to something opaque: the position is on its face, the value is inside."""
    samples = np.zeros((20, 20, 20), np.float32)
    samples[:, :, 10:] = 100
    tf = wvr.TransferFunction([(0, "red", 0.0), (50, "red", 0.0), (51, "red", 0.99), (100, "red", 0.99)])
    camera = wvr.Camera((-50, 9.5, 9.5), (9.5, 9.5, 9.5))
    for projection in (camera, wvr.Camera(camera.position, camera.target, parallel_scale=12.0)):
        view = Source([wvr.Volume(samples)], wvr.defaults.Call(tf, projection))
        with Client(view, size=(41, 41)) as client:
            client.say("pointer_move", x=20.5, y=20.5, button=0)
            picked = client.last("picked")
            assert picked["position"] == pytest.approx((9.6, 9.5, 9.5), abs=0.6)
            assert picked["value"] > 50 and picked["opacity"] > 0.99
            client.say("clip", kind="plane", set={"on": True, "normal": [1, 0, 0], "at": 0.8})
            client.say("pointer_move", x=20.5, y=20.5, button=0)
            assert client.last("picked")["position"][0] == pytest.approx(15.2, abs=0.6)
            client.say("pointer_move", x=0.5, y=0.5, button=0)
            assert "position" not in client.last("picked")
            client.say("clip", kind="plane", set={"on": False})
            client.say("focus", x=20.5, y=20.5)
            assert client.session.state.presentation.camera.target == pytest.approx((9.6, 9.5, 9.5), abs=0.6)


@pytest.mark.parametrize("absent", [-np.inf, np.inf, np.nan])
def test_nothing_is_picked_beside_samples_that_are_not_finite(absent):
    """They are nothing, also where the transfer function shows all scalars beyond its ends."""
    samples = np.zeros((20, 20, 20), np.float32)
    samples[:, :, :10] = absent
    tf = wvr.TransferFunction([(0, "red", 0.5), (100, "red", 0.5)])
    view = Source([wvr.Volume(samples, nan="transparent")], Call(tf, wvr.Camera((-50, 9.5, 9.5), (9.5, 9.5, 9.5))))
    with Client(view, size=(41, 41)) as client:
        client.say("pointer_move", x=20.5, y=20.5, button=0)
        picked = client.last("picked")
        assert picked["value"] == 0 and picked["position"][0] > 10
        client.session.greet()
        client.final()
        assert all(dumps(message) for message in client.messages) and not client.errors


def test_a_bound_that_is_infinite_is_none_in_a_message():
    """Of a maximum where rounding decides whether rays meet the volume."""
    samples = np.random.default_rng(1).integers(0, 120, (9, 11, 13)).astype(np.uint8)
    camera = wvr.Camera((6, 5, 50), (6, 5, 4), up=(0, 1, 0), parallel_scale=5.5)
    method = wvr.Projection("max")
    call = Call([(0, "black", 0.0), (255, "white", 1.0)], camera, integrator=method)
    with Client(Source([samples], call, {"integrator": method}), size=(13, 11)) as client:
        assert client.final().image.max_error == np.inf and client.last("picture")["bound"] is None
        assert all(dumps(message) for message in client.messages)


def test_frames_are_volumes():
    volumes = [wvr.Volume(np.full((8, 8, 8), value, np.float32)) for value in (0.2, 0.8)]
    tf = wvr.TransferFunction([(0, "red", 0.0), (1, "white", 0.5)])
    with Client(Source(volumes, wvr.defaults.Call(tf))) as client:
        first = client.final()
        client.say("frame", index=1)
        assert assert_still(client).image.rgba.max() > first.image.rgba.max()
        client.say("frame", index=2)
        assert "frame must be from 0 to 1" in client.errors[-1]
        client.session.greet()
        assert client.last("source")["frames"] == 2


def test_labels_are_shown_and_not_edited():
    volume = wvr.datasets.load("blobs", 16)
    labels = np.zeros(volume.shape, np.uint8)
    labels[8:] = 1
    tf = wvr.TransferFunction([(0, "red", 0.0), (255, "white", 0.5)])
    call = wvr.defaults.Call(tf, wvr.Camera.fit(volume), segmentation=wvr.Segmentation(labels, {1: tf}))
    with Client(Source([volume], call)) as client:
        picture = client.final()
        assert picture.met and picture.image.rgba.max() > 0
        client.session.greet()
        assert client.last("state")["points"] is None and client.last("source")["suggestions"] == []
        client.say("edit", op="density", factor=2)
        assert "of labels" in client.errors[-1]
        client.say("view", name="reset")
        client.say("pointer_move", x=30, y=20, button=0)
        client.say("script")
        assert "segmentation=segmentation" in client.last("text")["text"] and len(client.errors) == 1


def test_a_mean_over_labels_has_the_colours_of_a_transfer_function():
    volume = wvr.datasets.load("blobs", 16)
    tf = wvr.TransferFunction([(0, "red", 0.0), (255, "white", 0.5)])
    labels = wvr.Segmentation(np.ones(volume.shape, np.uint8), {1: tf})
    mean = wvr.Projection("mean")
    call = wvr.defaults.Call(tf, wvr.Camera.fit(volume), segmentation=labels, integrator=mean)
    with Client(Source([volume], call, {"integrator": mean})) as client:
        picture = client.final()
        truth = wvr.render(volume, tf, call.camera, picture.image.size, segmentation=labels, integrator=mean)
        assert np.array_equal(picture.image.rgba, truth.rgba) and not client.errors


def test_views_and_projections():
    with Client(source()) as client:
        for name in ("iso", "xy", "zx", "reset"):
            client.say("view", name=name)
            assert_still(client)
        client.say("parallel", on=True)
        assert assert_still(client) and client.last("state")["parallel"]
        client.say("view", name="yz")
        assert client.session.state.presentation.camera.parallel
        client.say("view", name="anterior")
        client.say("view", name="nowhere")
        assert len(client.errors) == 2 and "did you mean" not in client.errors[0]


def run_script(client):
    """All names once the script that is copied has run."""
    client.say("script")
    names = {"volume": client.session.source.first_volume}
    exec(client.last("text")["text"], names)
    return names


@pytest.mark.parametrize("options", [{"lighting": True}, {"clip": wvr.ClipSphere((12, 12, 12), 9.0)}], ids=str)
def test_the_script_renders_the_picture(options, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with Client(source(tolerance=2e-3, **options)) as client:
        client.say("key_down", key="ArrowUp", modifiers=[])
        client.say("edit", op="color", index=1, color="#3fa9e0")
        if "clip" in options:
            client.say("clip", kind="box", set={"on": True})
        else:
            client.say("light", lamp=[10, 20], shadows=True)
        picture, names = client.final(), run_script(client)
        assert np.array_equal(names["image"].rgba, picture.image.rgba)
        assert (tmp_path / "image.png").exists()
        client.say("camera")
        assert np.array_equal(
            eval(client.last("text")["text"]).position, client.session.state.presentation.camera.position
        )


@pytest.mark.parametrize(
    "method",
    [
        wvr.AdaptivePreintegrated(1e-2),
        wvr.AdaptiveSimpson(1e-2),
        wvr.Certified(1e-2),
        wvr.Exact(),
        wvr.Isosurface((100.0, 120.0)),
        wvr.Preintegrated(),
        wvr.Projection("mean"),
        wvr.Riemann(2.0),
        wvr.Simpson(2.0),
    ],
    ids=repr,
)
def test_the_script_knows_all_integrators(method, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with Client(source(integrator=method), size=(16, 12)) as client:
        picture, names = client.final(), run_script(client)
        assert np.array_equal(names["image"].rgba, picture.image.rgba)


def test_every_integrator_is_among_the_names_of_scripts():
    kinds = {
        name for name in wvr.__all__ if isinstance(kind := getattr(wvr, name), type) and issubclass(kind, Integrator)
    }
    assert len(kinds) == 9 and kinds <= set(NAMES)


@pytest.mark.parametrize("background", ["white", [0, 0.5, 1], np.array([0.1, 0.2, 0.3], np.float32)], ids=repr)
def test_the_script_has_the_background(background, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with Client(source(background=background), size=(16, 12)) as client:
        picture, names = client.final(), run_script(client)
        assert np.array_equal(names["image"].to_uint8(), picture.pixels)


@pytest.mark.parametrize("background", [None, "transparent"])
def test_there_is_something_behind_on_a_screen(background):
    """Else pictures would be drawn over older ones, which would be seen through them."""
    with Client(source(background=background), size=(16, 12)) as client:
        picture = assert_still(client)
        assert picture.pixels.shape == (12, 16, 3) and np.array_equal(picture.pixels, picture.image.to_uint8("black"))


def test_a_lost_state_comes_back():
    """What a page was last told makes a new session show the same."""
    with Client(source(lighting=True)) as client:
        client.say("edit", op="move", index=1, scalar=0.4, opacity=0.3)
        client.say("clip", kind="sphere", set={"on": True, "radius": 0.4})
        client.say("light", lamp=[15, 25])
        client.say("key_down", key="ArrowRight", modifiers=[])
        client.say("marks", outline=True)
        before = client.final()
        known = json.loads(dumps(client.last("state")))
        known["camera"] = json.loads(dumps(client.last("picture")["camera"]))
    with Client(source(lighting=True)) as again:
        again.say("restore", state=known)
        after = again.final()
        assert not again.errors
        assert np.array_equal(after.image.rgba, before.image.rgba) and np.array_equal(after.pixels, before.pixels)


@pytest.mark.parametrize(
    "message",
    [
        {"type": "edit", "op": "move", "index": 99, "scalar": 0, "opacity": 0},
        {"type": "edit", "op": "explode"},
        {"type": "edit"},
        {"type": "edit", "op": "choose", "name": "/etc/passwd.json"},
        {"type": "edit", "op": "load", "text": "{}"},
        {"type": "clip", "kind": "torus", "set": {}},
        {"type": "clip", "kind": "plane", "set": {"normal": [0, 0, 0], "on": True}},
        {"type": "clip", "kind": "plane", "set": {"colour": 1}},
        {"type": "clip", "kind": "sphere", "set": {"radius": "wide"}},
        {"type": "resize", "width": "a", "height": 1, "pixel_ratio": 1},
        {"type": "resize", "width": 10},
        {"type": "wheel", "dy": None},
        {"type": "pointer_down", "x": "left"},
        {"type": "restore", "state": {}},
        {"type": "frame", "index": -1},
        {"type": "light", "lamp": ["a", "b"]},
        {"type": "grab", "handle": "plane at", "at": [0.5, 0.5]},
        {"type": "grab"},
        {"type": "nudge", "handle": "sphere radius", "key": "ArrowUp"},
        {"type": "view", "name": ["iso"]},
    ],
    ids=str,
)
def test_wrong_messages_are_answered_and_change_nothing(message):
    with Client(source(), size=(16, 12)) as client:
        before = client.session.state
        client.session.receive(message)
        assert len(client.errors) == 1, client.messages
        assert client.session.state == before
        client.say("clip", kind="box", set={"on": True})
        assert client.final().whole


@pytest.mark.parametrize("message", [{}, {"type": 3}, {"type": "__init__"}, {"type": "show"}, {"type": "unknown"}])
def test_unknown_messages_are_nothing(message):
    with Client(source(), size=(16, 12)) as client:
        client.session.receive(message)
        assert not client.errors and client.final().whole


def test_huge_screens_are_not_rendered():
    with Client(source(integrator=wvr.Riemann(8.0)), size=(16, 12)) as client:
        client.session._loop.close()
        client.say("resize", width=100_000, height=100_000, pixel_ratio=4)
        width, height = client.session.state.presentation.size
        assert width * height <= 2**24


def test_closing_leaves_nothing():
    before = set(threading.enumerate())
    client = Client(source(), size=(200, 200))
    client.say("key_down", key="ArrowLeft", modifiers=[])
    client.session.close()
    shown = len(client.pictures)
    wait_for(lambda: not [t for t in threading.enumerate() if t not in before and t.name.startswith("wvr")])
    assert len(client.pictures) == shown


def test_a_canvas_of_rendercanvas_shows_the_still():
    offscreen = pytest.importorskip("rendercanvas.offscreen")
    from wvr.viewer.canvas import attach

    canvas = offscreen.OffscreenRenderCanvas(size=(64, 48))
    session = attach(canvas, source())
    assert session.settle(30) and session.state.presentation.size == (64, 48)
    canvas.submit_event({"event_type": "pointer_down", "x": 5, "y": 5, "button": 1, "modifiers": ()})
    canvas.submit_event({"event_type": "pointer_move", "x": 25, "y": 9, "button": 1, "buttons": (1,), "modifiers": ()})
    canvas._process_events()
    assert session.settle(30)
    scene = session.state.presentation
    image = wvr.render(session.source.first_volume, scene.transfer_function, scene.camera, (64, 48), background="black")
    assert np.array_equal(canvas.draw()[..., :3], image.to_uint8())
    assert not np.array_equal(scene.camera.position, session.source.first.camera.position)
    canvas.close()
    wait_for(lambda: not session._loop._thread.is_alive())


def test_views_frame_what_the_integrator_shows():
    """Of a maximum all that is not dark, as wvr.render does, and not what is opaque."""
    volume, method = wvr.datasets.load("blobs", 24), wvr.Projection("max")
    rare = [(0, "black", 0.0), (200, "white", 0.0), (255, "white", 0.9)]
    with Client(source_of(volume, rare, {"camera": "iso", "integrator": method})) as client:
        client.say("view", name="iso")
        image = wvr.render(volume, rare, "iso", (64, 48), integrator=method)
        assert np.array_equal(client.final().image.values, image.values, equal_nan=True)
