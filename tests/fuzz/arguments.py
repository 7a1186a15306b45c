"""Arguments of everything that is public: accepted and of use, or refused with an error."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import numpy as np

import wvr

CLEAR = (ValueError, TypeError, OSError, MemoryError, OverflowError, ImportError)
ARRAY = (np.arange(64, dtype=np.uint8) * 4).reshape(4, 4, 4)
WEIRD: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2, 3, 10**9, 2**31, 2**63, 2**64, -(2**63), 10**400, 0.5, 0.0, -0.0, 1e-300, 1e-45,
    1e-9, 1e9, 1e30, 1e300, -1e300, float("nan"), float("inf"), float("-inf"), 1j, "", "x", "red", "#12345", "auto",
    "cpu", b"bytes", (), [], {}, set(), (0,), (0, 0), (0, 0, 0), (1, 0, 0), (1, 1, 1), (-1, -1, -1), (1e300, 0, 0),
    (1e-300, 1, 1), (float("nan"), 0, 0), ("a", "b", "c"), ((0, 0, 0), (1, 1, 1)), [(0, "red", 0), (1, "blue", 1)],
    [(0, "red", 0), (0, "red", 1), (0, "red", 0.5)], [(1, "red", 0), (0, "red", 1)], [(0, "red", 2), (1, "red", -1)],
    np.zeros(0), np.zeros(3), np.zeros((3, 3)), np.eye(3), np.full((2, 2, 2), np.nan), np.zeros((2, 2, 2), bool),
    np.zeros((2, 2, 2), complex), np.zeros((2, 2, 2), np.int64), np.zeros((2, 2, 2), object), np.zeros((2, 2, 2), "U1"),
    np.zeros((2, 2, 2, 3), np.float32), np.zeros((4, 4, 4), np.uint8), np.float32(0.5), np.int8(1), np.array(0.5),
    object(), lambda *_: 1, Path("none"), int, wvr.Headlight(), wvr.Exact(), range(3), iter((1, 2, 3)), slice(None),
)  # fmt: skip


def bases() -> dict[str, tuple[Any, dict[str, Any]]]:
    """Everything public that is called, by name, and arguments that are right."""
    volume = wvr.Volume(ARRAY)
    points = [(0, "black", 0.0), (128, "red", 0.3), (255, "white", 0.9)]
    tf, camera = wvr.TransferFunction(points), wvr.Camera.fit(volume)
    image = wvr.Image(np.zeros((4, 4, 4), np.float32), np.zeros((4, 4), np.int32))
    scene = {"volume": volume, "transfer_function": tf, "camera": camera, "size": (4, 4), "device": "cpu"}
    table = wvr.preintegrate(tf, 4, device="cpu")
    other = {
        "AdaptivePreintegrated": {"tolerance": 1e-3},
        "AdaptiveSimpson": {"tolerance": 1e-3},
        "Camera": {"position": (9, 9, 9), "target": (1, 1, 1)},
        "Camera.fit": {"volume": volume},
        "Camera.orbit": {"volume": volume},
        "Camera.project": {"self": camera, "points": (1, 1, 1), "size": (4, 4)},
        "Certified": {"tolerance": 1e-3},
        "ClipBox": {"lo": (0, 0, 0), "hi": (2, 2, 2)},
        "ClipPlane": {"point": (1, 1, 1), "normal": (0, 0, 1)},
        "ClipSphere": {"center": (1, 1, 1), "radius": 1.0},
        "ClipVolume": {"volume": volume, "iso": 100.0},
        "Comparison": {"image": np.zeros((4, 4, 4)), "reference": np.zeros((4, 4, 4))},
        "ConvolutionShadows": {},
        "DirectionalLight": {"direction": (0, 0, 1)},
        "Enclosure": {"lower": np.zeros(4), "upper": np.ones(4)},
        "Exact": {},
        "Headlight": {},
        "Image": {"rgba": np.zeros((4, 4, 4), np.float32), "samples": np.zeros((4, 4), np.int32)},
        "Image.save": {"self": image, "path": Path("a.xyz")},
        "Image.to_uint8": {"self": image},
        "Lighting": {},
        "Preintegrated": {"step": 1.0},
        "Renderer": {"volume": volume, "transfer_function": tf},
        "Riemann": {"step": 1.0},
        "Segmentation": {"labels": ARRAY // 128, "transfer_functions": {1: tf}},
        "Simpson": {"step": 1.0},
        "Table": {"rgba": table.rgba, "domain": (0.0, 255.0), "length": 1.0},
        "Table.lookup": {"self": table, "sf": 0.0, "sb": 1.0},
        "TransferFunction": {"points": points},
        "TransferFunction.from_arrays": {"scalars": [0, 1], "rgb": [[0, 0, 0], [1, 1, 1]], "opacity": [0, 1]},
        "TransferFunction.from_colormap": {"name": "viridis", "domain": (0, 1), "opacity": [0, 1]},
        "TransferFunction.isosurfaces": {"values": [1, 2], "colors": ["red", "blue"]},
        "TransferFunction.preset": {"name": "ct-bone"},
        "TransferFunction.extinction": {"self": tf, "s": 0.5},
        "Volume": {"array": ARRAY},
        "as_volume": {"data": ARRAY},
        "compare": {"image": image, "reference": image},
        "datasets.load": {"name": "spheres", "size": 4},
        "enclose": {"volume": volume, "transfer_function": tf, "camera": camera, "x": 2, "y": 2, "size": (4, 4)},
        "get_num_threads": {},
        "orbit": {"data": volume, "transfer_function": tf, "frames": 2, "size": (4, 4)},
        "preintegrate": {"tf": tf, "n": 4, "device": "cpu"},
        "presets.suggest": {"volume": volume},
        "read": {"path": "none.nrrd"},
        "read_raw": {"path": "none.raw", "shape": (4, 4, 4), "dtype": "uint8"},
        "render": scene | {"integrator": wvr.Riemann(1.0)},
        "save_movie": {"images": [np.zeros((4, 4, 3), np.uint8)], "path": Path("a.gif")},
        "set_num_threads": {"n": 1},
        "single_scattering": scene | {"directions": 1, "step": 1.0},
        "time_series": {"data": [volume], "transfer_function": tf, "camera": camera, "size": (4, 4)},
        "warm_up": {"lighting": False, "dtype": "uint8", "integrator": wvr.Riemann(1.0), "device": "cpu"},
    }
    found = {}
    for name, given in other.items():
        call: Any = wvr
        for part in name.split("."):
            call = getattr(call, part)
        found[name] = call, given
    return found


class Arguments:
    def __init__(self, folder: Path):
        self.bases = bases()
        self.names = sorted(self.bases)

    def run(self, rng: np.random.Generator) -> str:
        """Call one with one or two odd arguments; what comes of it has to be of use."""
        name = self.names[rng.integers(len(self.names))]
        call, given = self.bases[name]
        given = dict(given)
        possible = [p for p in _parameters(call) if p not in ("self", "cancel")]
        if not possible:
            return ""
        for parameter in rng.choice(possible, min(len(possible), int(rng.geometric(0.8))), replace=False):
            given[str(parameter)] = WEIRD[rng.integers(len(WEIRD))]
        before = wvr.get_num_threads()
        try:
            made = call(**given)
            made = next(made) if inspect.isgenerator(made) else made
            if isinstance(made, wvr.Image):
                return "" if np.isfinite(made.rgba).all() else f"wrong: {name}({given}) is not finite"
            return self._used(name, made)
        except CLEAR as error:
            return "" if str(error) else f"unclear: {name}({given}) raises an empty {type(error).__name__}"
        finally:
            wvr.set_num_threads(before)

    def _used(self, name: str, made: Any) -> str:
        """Render a small image with what was made."""
        _, scene = self.bases["render"]
        scene = dict(scene)
        if isinstance(made, wvr.Volume):
            if made.numpy().size > 10**5:
                return ""
            scene |= {"volume": made, "camera": wvr.Camera.fit(made)}
        elif isinstance(made, wvr.TransferFunction):
            scene["transfer_function"] = made
        elif isinstance(made, wvr.Camera):
            scene["camera"] = made
        elif isinstance(made, wvr.Riemann | wvr.Preintegrated | wvr.Certified):
            scene["integrator"] = made
        elif isinstance(made, wvr.ClipBox | wvr.ClipPlane | wvr.ClipSphere):
            scene["clip"] = made
        else:
            return ""
        image = wvr.render(**scene)
        return "" if np.isfinite(image.rgba).all() else f"wrong: an image by {name}: {made!r} is not finite"


def _parameters(call: Any) -> list[str]:
    return [
        name
        for name, parameter in inspect.signature(call).parameters.items()
        if parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY)
    ]
