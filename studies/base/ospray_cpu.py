"""OSPRay's renderer for scientific visualization, ``scivis``, through its C interface, in a process of its own.

There is no package of OSPRay for Python. Its libraries are looked for in the folder that ``WVR_OSPRAY`` names, or in
the package ovito, whose wheels bring them. ``scivis`` samples at a fixed step, jittered, and leaps over what is empty.
"""

from __future__ import annotations

import ctypes
import os
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wvr

from .peer import NotAvailableError, Peer
from .scenes import Scene

# Of ospray/OSPEnums.h: types of parameters, and of objects by what they are called in strings.
INT, UINT, BOX1F = 4000, 4500, 10000
FLOATS = {1: 6000, 2: 6001, 3: 6002, 4: 6003}
OBJECTS = {"data": 100, "instance": 108, "light": 109, "transferFunction": 113, "volume": 114, "volumetricModel": 115}
SAMPLES = {np.dtype(np.uint8): 2500, np.dtype(np.uint16): 3500, np.dtype(np.float32): 6000}
RGBA32F, COLOR = 3, 1

# OSPRay's table of a transfer function is uniform; so many entries a grey level, of which floats count as having 255.
ENTRIES = 16


class OsprayCpu(Peer):
    """A scene in OSPRay; used with ``with``.

    Parameters
    ----------
    scene
        With a volume of uint8, uint16 or float32 whose axes are the world's.
    threads
        Its number of threads.
    """

    def __init__(self, scene: Scene, threads: int):
        super().__init__(Painter, scene, threads, hint="in OSPRay")


def _library() -> ctypes.CDLL:
    folders = [Path(os.environ["WVR_OSPRAY"])] if "WVR_OSPRAY" in os.environ else []
    if (spec := find_spec("ovito")) is not None:
        folders += [Path(place) / "plugins" for place in spec.submodule_search_locations or ()]
    found = [file for folder in folders for file in folder.glob("libospray.so*")]
    if not found:
        raise NotAvailableError("no libospray.so in the folder WVR_OSPRAY, nor in a package ovito")
    library = ctypes.CDLL(str(found[0]), mode=ctypes.RTLD_GLOBAL)
    pointer, text = ctypes.c_void_p, ctypes.c_char_p
    functions: dict[str, tuple[Any, ...]] = {  # what each returns and takes
        "ospNewDevice": (pointer, text),
        "ospDeviceSetParam": (None, pointer, text, ctypes.c_uint32, pointer),
        "ospDeviceCommit": (None, pointer),
        "ospSetCurrentDevice": (None, pointer),
        "ospNewVolume": (pointer, text),
        "ospNewTransferFunction": (pointer, text),
        "ospNewRenderer": (pointer, text),
        "ospNewCamera": (pointer, text),
        "ospNewLight": (pointer, text),
        "ospNewVolumetricModel": (pointer, pointer),
        "ospNewGroup": (pointer,),
        "ospNewInstance": (pointer, pointer),
        "ospNewWorld": (pointer,),
        "ospNewSharedData": (
            *(pointer, pointer, ctypes.c_uint32),
            *(ctypes.c_uint64, ctypes.c_int64) * 3,
            *(pointer, pointer),
        ),
        "ospNewFrameBuffer": (pointer, ctypes.c_int, ctypes.c_int, ctypes.c_uint32, ctypes.c_uint32),
        "ospSetParam": (None, pointer, text, ctypes.c_uint32, pointer),
        "ospCommit": (None, pointer),
        "ospRenderFrame": (pointer,) * 5,
        "ospWait": (None, pointer, ctypes.c_uint32),
        "ospRelease": (None, pointer),
        "ospResetAccumulation": (None, pointer),
        "ospMapFrameBuffer": (pointer, pointer, ctypes.c_uint32),
        "ospUnmapFrameBuffer": (None, pointer, pointer),
    }
    for name, (returned, *taken) in functions.items():
        function = getattr(library, name)
        function.restype, function.argtypes = returned, taken
    return library


class Painter:
    """A scene as OSPRay's objects."""

    def __init__(self, scene: Scene, threads: int):
        self.osp = _library()
        self.kept: list[Any] = []  # arrays that OSPRay shares
        if self.osp.ospLoadModule(b"cpu"):
            raise NotAvailableError("OSPRay does not load its module for processors")
        device, count = self.osp.ospNewDevice(b"cpu"), ctypes.c_int(threads)
        self.osp.ospDeviceSetParam(device, b"numThreads", INT, ctypes.byref(count))
        self.osp.ospDeviceCommit(device)
        self.osp.ospSetCurrentDevice(device)

        model = self._model(scene)
        group = self._committed(self.osp.ospNewGroup(), volume=self._handles("volumetricModel", model))
        instance = self._committed(self.osp.ospNewInstance(group))
        light = self._committed(self.osp.ospNewLight(b"ambient"), intensity=1.0)
        self.world = self._committed(
            self.osp.ospNewWorld(),
            instance=self._handles("instance", instance),
            light=self._handles("light", light),
        )
        self.renderer = self.osp.ospNewRenderer(b"scivis")
        self._set(self.renderer, pixelSamples=1, pixelFilter=np.uint32(0), backgroundColor=(0.0, 0.0, 0.0, 0.0))

        self.scene, (width, height) = scene, scene.size
        kind = b"perspective" if scene.camera.parallel_scale is None else b"orthographic"
        self.camera = self.osp.ospNewCamera(kind)
        self._set(self.camera, aspect=width / height)
        self.frame = self.osp.ospNewFrameBuffer(width, height, RGBA32F, COLOR)

    def draw(self, step: float, camera: wvr.Camera | None) -> None:
        osp, (width, height), volume = self.osp, self.scene.size, self.scene.volume
        camera = self.scene.camera if camera is None else camera
        forward = camera.target - camera.position
        forward /= np.linalg.norm(forward)
        parallel = camera.parallel_scale
        view = {"fovy": camera.view_angle} if parallel is None else {"height": 2 * parallel}
        self._committed(self.camera, position=camera.position, direction=forward, up=camera.up, **view)
        # At a rate of 1 OSPRay takes one sample a cell along the central ray.
        cell = (np.array(volume.spacing) / np.maximum(np.abs(forward), 1e-9)).min()
        self._committed(self.renderer, volumeSamplingRate=float(cell) / (step * volume.smallest_spacing))
        osp.ospResetAccumulation(self.frame)
        future = osp.ospRenderFrame(self.frame, self.renderer, self.camera, self.world)
        osp.ospWait(future, 100_000)
        osp.ospRelease(future)
        pixels = osp.ospMapFrameBuffer(self.frame, COLOR)
        floats = ctypes.cast(pixels, ctypes.POINTER(ctypes.c_float))
        self.rgba = np.ctypeslib.as_array(floats, (height, width, 4))[::-1].copy()
        osp.ospUnmapFrameBuffer(pixels, self.frame)

    def image(self) -> NDArray[np.floating]:
        return self.rgba

    def _model(self, scene: Scene) -> int:
        """The volume with its transfer function, whose opacity OSPRay takes for extinction in a unit of length."""
        volume, samples = scene.volume, scene.volume.numpy()
        if samples.dtype not in SAMPLES:
            raise NotAvailableError(f"OSPRay is given uint8, uint16 and float32 here, not {samples.dtype}")
        made = self._committed(
            self.osp.ospNewVolume(b"structuredRegular"),
            data=self._data(samples, SAMPLES[samples.dtype], samples.shape[::-1]),
            gridSpacing=volume.spacing,
            gridOrigin=volume.origin,
        )
        low, high = volume.range
        levels = int(high - low) if samples.dtype.kind == "u" else 255
        scalars = np.linspace(low, high, levels * ENTRIES + 1)
        tf = scene.transfer_function
        color = tf.color(scalars).astype(np.float32)
        extinction = tf.extinction(scalars, volume.smallest_spacing).astype(np.float32)
        function = self._committed(
            self.osp.ospNewTransferFunction(b"piecewiseLinear"),
            value=(BOX1F, (low, high)),
            color=self._data(color, FLOATS[3], (len(color),)),
            opacity=self._data(extinction, FLOATS[1], (len(extinction),)),
        )
        return self._committed(
            self.osp.ospNewVolumetricModel(made), transferFunction=("transferFunction", function), densityScale=1.0
        )

    def _data(self, array: NDArray, kind: int, shape: tuple[int, ...]) -> tuple[str, int]:
        """An array that OSPRay shares."""
        self.kept.append(array := np.ascontiguousarray(array))
        nx, ny, nz = (*shape, 1, 1)[:3]
        data = self.osp.ospNewSharedData(array.ctypes.data, kind, nx, 0, ny, 0, nz, 0, None, None)
        return "data", self._committed(data)

    def _handles(self, kind: str, one: int) -> tuple[str, int]:
        return self._data(np.array([one], np.uint64), 0x8000000 + OBJECTS[kind], (1,))

    def _committed(self, made: int, **parameters: Any) -> int:
        self._set(made, **parameters)
        self.osp.ospCommit(made)
        return made

    def _set(self, made: int, **parameters: Any) -> None:
        for name, value in parameters.items():
            kind, number = _encoded(value)
            self.osp.ospSetParam(made, name.encode(), kind, ctypes.byref(number))


def _encoded(value: Any) -> tuple[int, Any]:
    """The type of a parameter, and its value in C."""
    match value:
        case (str(kind), int(handle)):
            return 0x8000000 + OBJECTS[kind], ctypes.c_void_p(handle)
        case (int(kind), (float(), float()) as pair):
            return kind, (ctypes.c_float * 2)(*pair)
        case int():
            return INT, ctypes.c_int(value)
        case np.unsignedinteger():
            return UINT, ctypes.c_uint32(int(value))
    numbers = np.atleast_1d(np.asarray(value, np.float64)).tolist()
    return FLOATS[len(numbers)], (ctypes.c_float * len(numbers))(*numbers)
