"""Arguments of everything that is public: accepted and of use, or refused with an error that names the argument."""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import wvr
from wvr.integrators import Integrator

# What errors about arguments may be; what a system refuses (a place to write to, memory) does not name them.
CLEAR, OF_THE_SYSTEM = (ValueError, TypeError, IndexError), (OSError, MemoryError, ImportError)
ARRAY = (np.arange(64, dtype=np.uint8) * 4).reshape(4, 4, 4)


# Names by which messages speak of a part of an argument.
PARTS: dict[str, tuple[str, ...]] = {
    "data": ("array", "samples", "file"),
    "camera": ("position", "target", "up"),
    "colors": ("file",),  # errors of what is iterated are its own
    "images": ("file",),
    "labels": ("array",),
    "image_data": ("array", "samples", "pyvista"),
    "points": ("scalar", "scalars", "colour", "rgb", "opacity"),
    "position": ("up",),
    "scalars": ("rgb", "opacity"),
    "store": ("ndarray",),
    "target": ("up",),
    "transfer_function": ("colormap", "scalars", "opacity"),
    "values": ("scalars", "colors", "width"),
    "volume": ("array", "data", "samples"),
}


class Labelled(np.ndarray):
    """An array as some libraries have: of a class of their own."""


def _made() -> tuple[Any, ...]:
    """Values that are used up or closed are made anew for every case."""
    closed = open(__file__, "rb")  # noqa: SIM115
    closed.close()
    return iter((1, 2, 3)), (k for k in range(3)), closed, memoryview(bytes(64)), np.nditer(np.zeros(3))


WEIRD: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2, 3, 10**9, 2**31, 2**63, 2**64, -(2**63), 10**400, 0.5, 0.0, -0.0, 1e-300, 1e-45,
    1e-9, 1e9, 1e30, 1e300, -1e300, float("nan"), float("inf"), float("-inf"), 1j, "", "x", "red", "#12345", "auto",
    "cpu", "cuda:7", "größe", "体积.png", "a\0b", "x" * 5000, "../..", "~", "-", b"bytes", bytearray(b"12"), Path(),
    Path("none"), Path("/dev/null"), Path("/proc/self/mem"), (), [], {}, set(), frozenset((1, 2, 3)), {0: 1, 1: 2},
    (0,), (0, 0), (0, 0, 0), (1, 0, 0), (1, 1, 1), (-1, -1, -1), (1e300, 0, 0), (1e-300, 1, 1), (float("nan"), 0, 0),
    ("a", "b", "c"), ((0, 0, 0), (1, 1, 1)), (4, 4), (4.0, 4.0), (4.5, 4), ("4", "4"), (10**6, 10**6), (4, -4),
    (4, 4, 4), [(0, "red", 0), (1, "blue", 1)], [(0, "red", 0), (0, "red", 1), (0, "red", 0.5)],
    [(1, "red", 0), (0, "red", 1)],
    [(0, "red", 2), (1, "red", -1)], [[[[[0]]]]], [None, None], [[1, 2], [3]], np.zeros(0), np.zeros(3),
    np.zeros((3, 3)), np.eye(3), np.eye(4), np.full((2, 2, 2), np.nan), np.full((2, 2, 2), 1e300),
    np.zeros((2, 2, 2), bool), np.zeros((2, 2, 2), complex), np.zeros((2, 2, 2), np.int64),
    np.full((2, 2, 2), 2**64 - 1, np.uint64), np.zeros((2, 2, 2), object), np.zeros((2, 2, 2), "U1"),
    np.zeros((2, 2, 2), "S1"), np.zeros((2, 2, 2), "M8[s]"), np.zeros((2, 2, 2), [("r", "u1"), ("g", "u1")]),
    np.zeros((2, 2, 2), np.longdouble), np.zeros((2, 2, 2, 3), np.float32), np.zeros((4, 4, 4), np.uint8),
    np.zeros((1, 1, 1), np.float16), np.zeros((0, 4, 4)), np.broadcast_to(np.float32(1), (3, 3, 3)),
    np.ma.masked_equal(np.zeros((2, 2, 2)), 0), np.float32(0.5), np.float16(1), np.float64("nan"), np.int8(1),
    np.uint64(2**64 - 1), np.bool_(True), np.str_("red"), np.array(0.5), np.array("red"), np.array(None),
    np.datetime64("2026-01-01"), object(), lambda *_: 1, int, np.float32, "float32", ">f4", wvr.Headlight(),
    wvr.Exact(), wvr.DirectionalLight((0, 0, 1)), wvr.ClipSphere((1, 1, 1), 1.0), wvr.Lighting(),
    wvr.ConvolutionShadows(), range(3), slice(None), Ellipsis, NotImplemented, Exception("x"),
)  # fmt: skip


def _bends(value: Any, rng: np.random.Generator) -> list[Callable[[Any], Any]]:
    """What makes of a right argument one that nearly is."""
    if isinstance(value, str):
        return [str.encode, str.upper, np.str_, np.array, list, Path, lambda v: v + " ", lambda v: v[:-1]]
    if isinstance(value, bool | int | float):
        return [
            np.float32, np.float16, np.array, str, complex, float, np.longdouble, lambda v: [v], lambda v: -v,
            lambda v: np.array([v]), lambda v: v * 1e30, lambda v: v * 1e-30, lambda v: v * 1e300, lambda v: v + 0.5,
            lambda v: np.int16(v), lambda v: int(v + 1) * 10**20, lambda v: v + 10**5,
        ]  # fmt: skip
    if isinstance(value, np.ndarray):
        return [
            np.asfortranarray, np.ndarray.tolist, memoryview, lambda v: v[::-1], lambda v: v[..., ::2], lambda v: v[:0],
            lambda v: v[0], lambda v: v.astype(np.float16), lambda v: v.astype(">f4"), lambda v: v.astype(object),
            lambda v: v * 1e38, lambda v: v * np.inf, lambda v: v.astype(complex), lambda v: v[None],
            lambda v: v.view(Labelled), lambda v: np.broadcast_to(v[:1], v.shape), lambda v: np.ma.masked_greater(v, 2),
            lambda v: np.swapaxes(v, 0, -1), lambda v: -v.astype(float), lambda v: v.astype(np.int64),
            lambda v: np.repeat(v, 2, axis=0), lambda v: v.astype("U"), lambda v: v.astype(bool),
            lambda v: np.where(rng.random(v.shape) < 0.1, np.nan, v), lambda v: v.astype(float) * 1e-320,
        ]  # fmt: skip
    if isinstance(value, tuple | list) and value:
        return [
            np.array, list, tuple, iter, lambda v: v[::-1], lambda v: v[:-1], lambda v: [*v, v[-1]], lambda v: [v],
            lambda v: [bent(v[0], rng), *v[1:]], lambda v: [*v[:-1], bent(v[-1], rng)], lambda v: [None, *v[1:]],
            lambda v: set(map(str, v)), lambda v: dict(enumerate(v)), lambda v: np.array(v, object),
            lambda v: [float("nan"), *v[1:]], lambda v: [*v[:-1], 1e300], lambda v: (k for k in v), lambda v: v * 200,
        ]  # fmt: skip
    if isinstance(value, Path):
        return [str, bytes, lambda v: v / "below", lambda v: v.with_suffix(".PNG"), lambda v: [v], lambda v: v.parent]
    if isinstance(value, dict):
        return [
            list, lambda v: {str(k): one for k, one in v.items()}, lambda v: {k - 5: one for k, one in v.items()},
            lambda v: {k + 0.5: one for k, one in v.items()}, lambda v: {1: None},
        ]  # fmt: skip
    return [lambda v: [v], lambda v: (v, v), lambda v: {"a": v}, lambda v: lambda: v, repr, type]


def bent(value: Any, rng: np.random.Generator) -> Any:
    """Nearly the right argument."""
    bends = _bends(value, rng)
    with np.errstate(all="ignore"):
        try:
            return bends[rng.integers(len(bends))](value)
        except (TypeError, ValueError, OverflowError):  # there is no such
            return [value]


def bases(folder: Path) -> dict[str, tuple[Any, dict[str, Any]]]:
    """Everything public that is called, by name, and arguments that are right."""
    volume = wvr.Volume(ARRAY)
    points = [(0, "black", 0.0), (128, "red", 0.3), (255, "white", 0.9)]
    tf, camera = wvr.TransferFunction(points), wvr.Camera.fit(volume)
    image = wvr.Image(np.zeros((4, 4, 4), np.float32), np.zeros((4, 4), np.int32))
    scene = {"volume": volume, "transfer_function": tf, "camera": camera, "size": (4, 4), "device": "cpu"}
    table = wvr.preintegrate(tf, 4, device="cpu")
    raw = folder / "a.raw"
    raw.write_bytes(ARRAY.tobytes())
    np.save(folder / "a.npy", ARRAY)
    tf.save(folder / "a.json")
    comparison = wvr.compare(image, image)
    seen = wvr.render(volume, tf, camera, (4, 4), integrator=wvr.Riemann(1.0), device="cpu")
    given: dict[str, dict[str, Any]] = {
        "AdaptivePreintegrated": {"tolerance": 1e-3},
        "AdaptiveSimpson": {"tolerance": 1e-3},
        "BoundedImage": {
            "rgba": np.zeros((4, 4, 4), np.float32),
            "samples": np.zeros((4, 4), np.int32),
            "error_bound": np.zeros((4, 4), np.float32),
        },
        "Camera": {"position": (9.0, 9.0, 9.0), "target": (1.0, 1.0, 1.0)},
        "Camera.fit": {"volume": volume},
        "Camera.from_pyvista": {"camera": camera.to_pyvista()},
        "Camera.orbit": {"volume": volume},
        "Camera.project": {"self": camera, "points": (1.0, 1.0, 1.0), "size": (4, 4)},
        "Camera.rays": {"self": camera, "size": (4, 4)},
        "Camera.unproject": {"self": camera, "x": 1.0, "y": 1.0, "depth": 3.0, "size": (4, 4)},
        "Certified": {"tolerance": 1e-3},
        "ClipBox": {"lo": (0.0, 0.0, 0.0), "hi": (2.0, 2.0, 2.0)},
        "ClipPlane": {"point": (1.0, 1.0, 1.0), "normal": (0.0, 0.0, 1.0)},
        "ClipSphere": {"center": (1.0, 1.0, 1.0), "radius": 1.0},
        "ClipVolume": {"volume": volume, "iso": 100.0},
        "Comparison": {"difference": np.zeros((4, 4, 4)), "limits": (1e-2, 1e-3)},
        "Comparison.histogram": {"self": comparison, "decades": (1e-3, 1e-2, 0.1)},
        "Comparison.save": {"self": comparison, "path": folder / "c.png"},
        "ConvolutionShadows": {},
        "DirectionalLight": {"direction": (0.0, 0.0, 1.0)},
        "Enclosure": {"lower": np.zeros(4), "upper": np.ones(4)},
        "Exact": {},
        "Headlight": {},
        "Image": {"rgba": np.zeros((4, 4, 4), np.float32), "samples": np.zeros((4, 4), np.int32)},
        "Image.composited": {"self": image, "background": "white"},
        "Image.depth": {"self": seen, "opacity": 0.5},
        "Image.pick": {"self": seen, "x": 1, "y": 2},
        "Image.png": {"self": image},
        "Image.save": {"self": image, "path": folder / "a.png"},
        "Image.to_uint8": {"self": image},
        "Isosurface": {"values": [90.0, 140.0]},
        "Lighting": {},
        "Preintegrated": {"step": 1.0},
        "Projection": {"what": "max"},
        "Renderer": {"volume": volume, "transfer_function": tf, "integrator": wvr.Riemann(1.0), "device": "cpu"},
        "Renderer.render": {
            "self": wvr.Renderer(volume, tf, integrator=wvr.Riemann(1.0), device="cpu"),
            "camera": camera,
            "size": (4, 4),
        },
        "Riemann": {"step": 1.0},
        "Segmentation": {"labels": ARRAY // 128, "transfer_functions": {1: tf}},
        "Simpson": {"step": 1.0},
        "Table": {"rgba": table.rgba, "domain": (0.0, 255.0), "length": 1.0},
        "Table.lookup": {"self": table, "front": 0.0, "back": 1.0},
        "TransferFunction": {"points": points},
        "TransferFunction.color": {"self": tf, "s": 0.5},
        "TransferFunction.extinction": {"self": tf, "s": 0.5},
        "TransferFunction.for_volume": {"self": tf, "volume": volume},
        "TransferFunction.from_arrays": {"scalars": [0, 1], "rgb": [[0, 0, 0], [1, 1, 1]], "opacity": [0, 1]},
        "TransferFunction.from_colormap": {"colormap": "viridis", "domain": (0, 1), "opacity": [0, 1]},
        "TransferFunction.isosurfaces": {"values": [1, 4], "colors": ["red", "blue"]},
        "TransferFunction.load": {"path": folder / "a.json"},
        "TransferFunction.preset": {"name": "ct-bone"},
        "TransferFunction.save": {"self": tf, "path": folder / "b.json"},
        "Volume": {"array": ARRAY},
        "Volume.from_pyvista": {"image_data": volume.to_pyvista()},
        "as_volume": {"data": ARRAY},
        "build_ranges": {"store": folder / "a.npy"},
        "compare": {"image": image, "reference": image},
        "datasets.load": {"name": "spheres", "size": 4},
        "enclose": {"volume": volume, "transfer_function": tf, "camera": camera, "x": 2, "y": 2, "size": (4, 4)},
        "get_num_threads": {},
        "open": {"store": folder / "a.npy"},
        "orbit": {"data": volume, "transfer_function": tf, "frames": 2, "size": (4, 4)},
        "preintegrate": {"tf": tf, "n": 4, "device": "cpu"},
        "presets.suggest": {"volume": volume},
        "read": {"path": folder / "a.npy"},
        "read_raw": {"path": raw, "shape": (4, 4, 4), "dtype": "uint8"},
        "render": scene | {"integrator": wvr.Riemann(1.0)},
        "save_movie": {"images": [np.zeros((4, 4, 3), np.uint8)], "path": folder / "a.gif"},
        "set_num_threads": {"n": 1},
        "single_scattering": scene | {"directions": 1, "step": 1.0},
        "time_series": {"data": [volume], "transfer_function": tf, "camera": camera, "size": (4, 4)},
        "warm_up": {"lighting": False, "dtype": "uint8", "integrator": wvr.Riemann(1.0), "device": "cpu"},
    }
    found = {}
    for name, arguments in given.items():
        call: Any = wvr
        for part in name.split("."):
            call = getattr(call, part)
        found[name] = call, arguments
    return found


class Arguments:
    def __init__(self, folder: Path):
        self.bases = bases(folder)
        self.names = sorted(self.bases)
        self.subject = ""

    def run(self, rng: np.random.Generator) -> str:
        """Call one with one or two odd arguments; what comes of it has to be of use."""
        name = self.names[rng.integers(len(self.names))]
        call, right = self.bases[name]
        given = dict(right)
        possible = [p for p in parameters(call) if p not in ("self", "cancel")]
        if not possible:
            return ""
        odd = [str(p) for p in rng.choice(possible, min(len(possible), int(rng.geometric(0.8))), replace=False)]
        weird = WEIRD + _made()
        self.subject = f"{name}, accepted"
        for parameter in odd:
            nearly = parameter in right and rng.random() < 0.5
            given[parameter] = bent(right[parameter], rng) if nearly else weird[rng.integers(len(weird))]
        before = wvr.get_num_threads()
        try:
            made = call(**given)
            made = next(made) if inspect.isgenerator(made) else made
            return self._used(name, made, odd)
        except CLEAR as error:
            self.subject = f"{name}, refused"
            what = {one: given[one] for one in odd}
            return "" if _names(str(error), what) else f"unclear: {name}({what}): {type(error).__name__}: {error}"
        except OF_THE_SYSTEM as error:
            self.subject = f"{name}, refused"
            return "" if str(error) else f"unclear: {name} raises an empty {type(error).__name__}"
        finally:
            wvr.set_num_threads(before)

    def _used(self, name: str, made: Any, odd: list[str]) -> str:
        """Render a small image with what was made."""
        _, right = self.bases["render"]
        scene = dict(right)
        if isinstance(made, wvr.Image):
            given = name in ("Image", "BoundedImage")
            return "" if given or np.isfinite(made.rgba).all() else f"wrong: an image by {name} is not finite"
        if isinstance(made, wvr.Volume):
            if made.numpy().size > 10**5:
                return ""
            scene |= {"volume": made, "camera": wvr.Camera.fit(made)}
        elif isinstance(made, wvr.StoredVolume):
            scene["volume"] = made
        elif isinstance(made, wvr.TransferFunction):
            scene["transfer_function"] = made
        elif isinstance(made, wvr.Camera):
            scene["camera"] = made
        elif isinstance(made, wvr.Renderer):
            made, scene = made.render(scene["camera"], (4, 4)), {}
        elif isinstance(made, Integrator):
            scene["integrator"] = made
        elif isinstance(made, wvr.ClipBox | wvr.ClipPlane | wvr.ClipSphere):
            scene["clip"] = made
        elif isinstance(made, wvr.Segmentation):
            scene["segmentation"] = made
        else:
            return ""
        try:
            image = wvr.render(**scene) if scene else made
        except MemoryError:
            return ""
        except CLEAR as error:  # what fits no scene
            named = _names(str(error), dict.fromkeys([*odd, *scene, "clip", "segmentation"]))
            return "" if named else f"unclear: {made!r} by {name}: {type(error).__name__}: {error}"
        return "" if np.isfinite(image.rgba).all() else f"wrong: an image by {name}: {made!r} is not finite"


def _names(message: str, given: dict[str, Any]) -> bool:
    """Whether a message says which argument it is about: by its name or a part's, or by the path that it is."""
    words = set(re.findall(r"[a-z_0-9]+", message.lower()))
    paths = [os.fsdecode(value) for value in given.values() if isinstance(value, str | bytes | os.PathLike)]
    return any({one.lower(), *PARTS.get(one, ())} & words for one in given) or any(p and p in message for p in paths)


def parameters(call: Any) -> list[str]:
    return [
        name
        for name, parameter in inspect.signature(call).parameters.items()
        if parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY)
    ]
