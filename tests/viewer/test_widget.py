"""The widget of notebooks: without one, and in one that is executed from the command line."""

from __future__ import annotations

import base64
import json
import subprocess
import sys
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

import wvr
from tests.viewer.helpers import source, wait_for

pytest.importorskip("anywidget")

from wvr.viewer.widget import Widget, front_end

CELL = """import wvr
wvr.view(wvr.datasets.load("blobs", 16), "viridis", opacity="linear")
"""


def pixels(png):
    return np.array(Image.open(BytesIO(png)).convert("RGB"))


@pytest.fixture
def widget(monkeypatch):
    sent = []
    monkeypatch.setattr(Widget, "send", lambda self, content, buffers=None: sent.append((content, buffers)))
    shown = Widget(source())
    shown.sent = sent
    yield shown
    shown.close()


def of_kind(widget, kind):
    return [one for one in widget.sent if one[0]["type"] == kind]


def test_a_still_is_there_at_once(widget):
    """For whoever has no kernel: in the cell's output and in the widget's saved state."""
    scene = widget.session.state.presentation
    image = wvr.render(widget.session.source.first_volume, scene.transfer_function, scene.camera, background="black")
    data, _ = widget._repr_mimebundle_()
    assert np.array_equal(pixels(base64.b64decode(data["image/png"])), image.to_uint8())
    assert "application/vnd.jupyter.widget-view+json" in data
    assert data["image/png"] in widget.get_state()["still"]
    assert not of_kind(widget, "picture"), "nobody looks yet"


def test_views_are_sent_what_they_can_draw(widget):
    widget._receive(widget, {"type": "hello"}, [])
    assert of_kind(widget, "source") and of_kind(widget, "state")
    wait_for(lambda: of_kind(widget, "picture"))
    for _ in range(20):
        widget._receive(widget, {"type": "key_down", "key": "ArrowLeft", "modifiers": []}, [])
    assert widget.session.settle(60)
    assert len(of_kind(widget, "picture")) == 2, "more are not sent before one is drawn"
    widget._receive(widget, {"type": "seen"}, [])
    message, (png,) = of_kind(widget, "picture")[-1]
    assert message["whole"] and message["camera"]["position"] == list(widget.session.state.presentation.camera.position)
    assert base64.b64encode(png).decode() in widget.still
    widget._receive(widget, "nonsense", [])
    widget._receive(widget, {"type": "edit", "op": "nonsense"}, [])
    assert len(of_kind(widget, "error")) == 1


def test_the_front_end_is_one_module():
    text = front_end()
    assert "import " not in text.replace("'import wvr'", "").split("// The viewer in a notebook")[0].splitlines()
    assert text.count("export ") == 1 and text.rstrip().endswith("export default { render }")


def test_a_notebook_is_executed_to_a_picture(tmp_path):
    """As ``jupyter nbconvert --execute`` does: the output has the picture, for readers without a kernel."""
    pytest.importorskip("ipykernel")
    pytest.importorskip("nbconvert")
    cell = {"cell_type": "code", "execution_count": None, "id": "a", "metadata": {}, "outputs": [], "source": CELL}
    notebook = {"cells": [cell], "metadata": {}, "nbformat": 4, "nbformat_minor": 5}
    (tmp_path / "a.ipynb").write_text(json.dumps(notebook))
    command = [sys.executable, "-m", "nbconvert", "--execute", "--to", "notebook", "--output", "b.ipynb", "a.ipynb"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    (made,) = json.loads((tmp_path / "b.ipynb").read_text())["cells"]
    outputs = [output for output in made["outputs"] if "data" in output]
    shown = pixels(base64.b64decode(outputs[-1]["data"]["image/png"]))
    assert shown.shape == (512, 512, 3) and shown.std() > 5
    assert "application/vnd.jupyter.widget-view+json" in outputs[-1]["data"]
