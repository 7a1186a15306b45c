"""Other renderers in processes of their own: what they draw comes back, what ends them ends nothing else."""

import os
from dataclasses import dataclass

import numpy as np
import pytest

import wvr
from studies import frontier
from studies.base import scenes
from studies.base.ospray_cpu import OsprayCpu
from studies.base.peer import NotAvailableError, Peer

from .helpers import rows_of


@dataclass
class Grey:
    """Paints its steps; steps below zero are too many for it."""

    shade: float

    def draw(self, step, camera):
        if step < 0:
            os._exit(3)
        if step == 0:
            raise ZeroDivisionError("no step")
        self.rgba = np.full((2, 3, 4), self.shade * step)

    def image(self):
        return self.rgba


def test_a_peer_is_another_process():
    with Peer(Grey, 0.5, hint="bad luck") as peer:
        time = peer.frame(0.25)
        assert time.wall >= 0 and np.array_equal(peer.image(), np.full((2, 3, 4), 0.125))
        with pytest.raises(NotAvailableError, match="no step"):
            peer.frame(0.0)
    with Peer(Grey, 0.5, hint="bad luck") as peer, pytest.raises(NotAvailableError, match=r"exit code 3 \(bad luck\)"):
        peer.frame(-1.0)


# Why OSPRay is not there, once that is known.
absent: list[str] = []


@pytest.mark.parametrize("name", ["bonsai", "bluntfin"])  # cubic voxels, and others of floats
@pytest.mark.parametrize("parallel", [False, True], ids=["perspective", "parallel"])
def test_ospray_converges_to_our_exact_images(name, parallel):
    """An independent renderer shows the same scene, the more so the finer its steps."""
    if absent:
        pytest.skip(absent[0])
    volume = wvr.datasets.load(scenes.SCANS[name].stand_in, 32)
    if name == "bluntfin":
        samples = volume.numpy()[::2, :, ::4].astype(np.float32)
        volume = wvr.Volume(samples, spacing=(4.0, 1.0, 2.0), origin=(5.0, -3.0, 1.0))
    scene = frontier.make_scenes(name, volume, (60, 50))["smooth"]
    if parallel:
        camera = wvr.Camera(scene.camera.position, scene.camera.target, scene.camera.up, parallel_scale=12.0)
        scene = scenes.Scene(name, volume, scene.transfer_function, camera, scene.size)
    exact = scene.render(wvr.Exact(), device="cpu").rgba
    errors = []
    with OsprayCpu(scene, 1) as peer:
        for step in (1.0, 0.25, 1 / 16):
            try:
                peer.frame(step)
            except NotAvailableError as error:
                absent.append(f"OSPRay is not available: {error}")
                pytest.skip(absent[0])
            errors.append(np.abs(peer.image() - exact).mean())
    assert errors[2] < 0.5 * errors[1] < 0.25 * errors[0] and errors[2] < 1e-3 * exact.max()


def test_certified_images_as_accurate_as_a_peer(tmp_path, monkeypatch):
    """Asked for the largest error that the peer was found to have, whatever that is, they are below it."""

    def start(scene, threads):
        return Peer(Askew, scene, hint="")

    monkeypatch.setattr(frontier, "PEERS", {"Askew": (start, "k", "x-")})
    said = frontier.peers(tmp_path, quick=True)
    assert "Askew takes" in said
    rows = rows_of(tmp_path, "peers")
    assert len(rows) == 3
    for row in rows:
        assert 0 < row["certified max error"] < row["peer max error"] and row["times"] > 0


class Askew:
    """wvr, from a little further to the left."""

    def __init__(self, scene):
        camera = scene.camera
        aside = 0.02 * np.cross(camera.up, camera.position - camera.target)
        moved = wvr.Camera(camera.position + aside, camera.target, camera.up, camera.view_angle)
        self.scene = scenes.Scene(scene.name, scene.volume, scene.transfer_function, moved, scene.size)

    def draw(self, step, camera):
        self.rgba = self.scene.render(wvr.Riemann(step), device="cpu").rgba

    def image(self):
        return self.rgba
