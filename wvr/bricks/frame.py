"""One image of a volume in bricks, from the camera outwards."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..frame import image_of
from ..image import Image
from ..keep import Keeper
from ..launch import in_turn
from ..memory import check_room
from ..probe import make_prober, tightest
from ..resident import Rays, fetched
from ..scene import Scene
from .brick import Caster, Halo
from .finder import Finder, caster_of
from .grid import Bricks, in_order
from .partial import Partial
from .reading import Reading, active_client
from .store import BESIDE, BrickStore
from .streamed import Streamed

# Cells of bricks along an axis, of volumes that have no chunks of their own, where there is room for such.
CELLS = (256, 128, 64, 32, 16)
# Rounding of a composition, in parts of the brightest colour.
COMPOSED = 2.0**-50
# Bytes of a pixel, and of one that is probed, while bricks are composed.
PIXEL, PROBED = 96, 256


def check(scene: Scene, reading: Reading) -> None:
    """Say so where a scene is not the composition of its parts.

    Raises
    ------
    ValueError
        For an integrator whose rays are not split, shadows, labels with segments of one length, and where something is
        not to be read and there is no bound to say so.
    """
    integrator = scene.integrator
    if not scene.volume.stored and not hasattr(scene.volume, "host"):
        raise ValueError(
            f"memory_limit is for volumes of samples, which a {type(scene.volume).__name__} does not have: leave it out"
        )
    if not (integrator.splits or integrator.probes):
        raise ValueError(
            f"integrator must be one whose rays are composed of those of bricks, such as Certified, for a volume in "
            f"bricks (memory_limit, client, wvr.open), got {integrator!r}, which says of itself that it does not split"
        )
    limited = reading.budgeted
    bounded = getattr(integrator.half(scene), "bounded", False)
    for name, given, value in (("budget", limited, "one"), ("missing", reading.missing == "bound", '"bound"')):
        if given and not bounded:
            raise ValueError(
                f"{name} = {value} needs an integrator with a bound on what is not read, Certified, Projection or "
                f"Isosurface, got {integrator!r}"
            )
        if given and not scene.volume.stored:
            raise ValueError(f"{name} is for volumes of wvr.open, got one in memory")
    if reading.client and integrator.probes and reading.missing == "bound":
        raise ValueError(f'client must be left out for {integrator!r} with missing="bound": use one or the other')
    if reading.client and (limited or not scene.volume.stored):
        what = "a budget" if limited else "a volume in memory: wvr.open takes arrays, too"
        raise ValueError(f"client is for volumes of wvr.open, without a budget, got {what}")
    if scene.shadows is not None:
        raise ValueError(
            "shadows are not there for a volume in bricks (memory_limit, client, wvr.open): leave them out"
        )
    if scene.segmentation is not None and getattr(integrator.half(scene), "anchored", False):
        raise ValueError(
            f"segmentation needs Certified, Exact or adaptive steps for a volume in bricks, got {integrator!r}: its "
            f"segments count from boundaries of labels, which may be in other bricks"
        )


class BrickedFrame:
    """A scene seen by a camera in so many pixels, brick by brick.

    Attributes
    ----------
    error_bound
        Of the image, once it is there; None where the integrator gives none.
    partly
        Whether something was left out that would be seen: for want of time, or as it could not be read.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        size: tuple[int, int],
        keep: Keeper,
        reading: Reading,
        ends: NDArray[np.float64] | None = None,
    ):
        check(scene, reading)
        alone = reading.budgeted or scene.integrator.seeks or (scene.integrator.probes and reading.missing == "bound")
        if scene.volume.stored and not alone and reading.client is None:
            reading = replace(reading, client=active_client())
        self.given, self.ends = scene, ends
        self.scene = scene.normal
        self.camera, self.size, self.keep, self.reading = camera, size, keep, reading
        self.error_bound: NDArray[np.float32] | None = None
        self.partly = False

    def render(self, store: BrickStore | None = None) -> tuple[Image, BrickStore | None]:
        """The image, and its bricks for the next one; those of the last one are taken where they are the same."""
        width, height = self.size
        needed = width * height * (PROBED if self.scene.integrator.probes else PIXEL)
        check_room(needed, None, "images of bricks", f"a smaller size than {width} x {height}")
        caster, image, stats, store = self._cast(store)
        return self.finish(caster, image, stats), store

    def found(self, pixel: tuple[int, int] | None) -> list[NDArray[np.float64]]:
        """Values, depths and colours that an integrator which probes finds in all pixels, or in one."""
        caster, *_ = self._cast(None, pixel)
        assert isinstance(caster, Finder)
        told = caster.told()
        return fetched(self.keep, told.values, told.depths, told.rgba)

    def _cast(
        self, store: BrickStore | None, only: tuple[int, int] | None = None
    ) -> tuple[Caster, Partial, dict[str, Any], BrickStore | None]:
        if not self.scene.volume.stored:
            return self._at_hand(store, only)
        march = Streamed(self.scene, self.camera, self.size, self.keep, self.reading, self.ends, only)
        image, stats = march.render()
        self.partly = bool(march.rest or stats["bricks_missing"])
        return march.caster, image, stats, None

    def bricks(self) -> Bricks:
        """How a volume in memory is cut."""
        field: Any = self.scene.volume
        room = float("inf") if self.reading.memory is None else self.reading.memory
        for cells in CELLS:
            largest = np.minimum(cells + 3, field.dimensions)
            # The next one comes while one is rendered, but where one is all.
            several = 2.0 if (largest < field.dimensions).any() else 1.0
            if several * float(np.prod(largest)) * (field.dtype.itemsize + BESIDE) <= room or cells == CELLS[-1]:
                break
        return Bricks.regular(field.dimensions, (cells,) * 3)

    def _at_hand(
        self, store: BrickStore | None, only: tuple[int, int] | None
    ) -> tuple[Caster, Partial, dict[str, Any], BrickStore]:
        start = perf_counter()
        bricks, halo = self.bricks(), Halo.of(self.scene)
        if store is None or not store.serves(self.scene.volume, bricks, halo, self.reading.memory):
            store = BrickStore(self.scene.volume, bricks, halo, self.reading.memory)
        caster = caster_of(self.scene, self.camera, self.size, bricks, self.keep, self.ends, only=only)
        image = caster.nothing()
        order = in_order(bricks, self.scene.volume, self.camera)
        rects = {index: rect for index in order if (rect := caster.footprint(index)) is not None}
        ready = {}
        if store.keeps_all and not isinstance(caster, Finder):
            caster.made = store.made(caster)
            # What is seen in this frame as well, most likely. Kernels in between would slow all of this down.
            ready = {index: caster.ready(index, store[index], rects[index]) for index in store.seen & rects.keys()}
        store.seen.clear()
        for index, rect in in_turn(list(rects.items())):
            if caster.ended(image, rect):
                caster.end(image, rect)
                continue
            store.seen.add(index)
            if (one := ready.get(index)) is not None:
                one.compose(image)
            elif index not in ready:
                caster.cast(index, store[index], image, rect)
            if not store.keeps_all:
                self.keep.end_of_frame()
        store.end_of_frame()
        stats = {"seconds": perf_counter() - start, "bricks": len(list(bricks)), "bricks_rendered": len(store.seen)}
        return caster, image, stats, store

    def finish(self, caster: Caster, partial: Partial, stats: dict[str, Any]) -> Image:
        """The image that all parts come to, rounded once."""
        scene, integrator = self.scene, self.scene.integrator
        stats |= {"bytes": scene.volume.nbytes, "integrator": repr(integrator)}
        shown = integrator.shown(scene)
        if isinstance(caster, Finder):
            return self._told(caster, shown, stats)
        rgba = partial.rgbt.astype(shown)
        rgba[..., 3] = 1.0 - partial.through
        # What unread bricks may look like is rounded, on whichever side of nothing.
        np.maximum(rgba, 0.0, out=rgba)
        if partial.bound is not None:
            rounding = float(np.finfo(shown).eps) / 2 + COMPOSED * sum(caster.bricks.counts)
            bound = partial.bound
            if scene.lighting is None and (wide := bound > 0.5).any():
                # What is true is between 0 and the brightest, and half of that or more from one of the two.
                there = partial.rgbt[wide]
                farthest = np.maximum(there, scene.brightest - there)
                farthest[..., 3] = np.maximum(1.0 - there[..., 3], there[..., 3])
                bound[wide] = np.minimum(bound[wide], farthest.max(axis=-1))
            bound += scene.brightest * rounding
            self.error_bound = tightest(bound.astype(np.float64, copy=False))
        return self._image(rgba, partial.samples, stats)

    def _told(self, caster: Finder, shown: str, stats: dict[str, Any]) -> Image:
        """The image of what was found."""
        told = caster.told()
        bounds = told.bounds.numpy() + (0.0 if caster.half is None else caster.half)
        valued = self.scene.integrator.valued
        self.error_bound = bounds if valued else tightest(bounds)
        image = self._image(told.rgba.numpy().astype(shown, copy=False), told.samples.numpy(), stats)
        image.values = told.values.numpy() if valued else None
        return image

    def _image(self, rgba: NDArray[np.floating], samples: NDArray[np.int32], stats: dict[str, Any]) -> Image:
        scene = self.scene
        tolerance = getattr(scene.integrator, "tolerance", 0.0)
        self.rays = Rays.of(samples, self.error_bound, tolerance)
        stats |= scene.integrator.report(self)  # type: ignore[arg-type]
        if scene.volume.stored and "bound_covers" in stats and not (scene.integrator.probes and not self.partly):
            stats["bound_covers"] += ", and what was not read"
        return image_of(self, rgba, samples, stats, prober=make_prober(self, self._again()))

    def _again(self) -> Callable[[Scene, Keeper, tuple[int, int] | None], list[NDArray[np.float64]]]:
        """Values, depths and colours of another scene, of whatever has to be read for it; without this frame, whose
        keeper has more than an image should hold.
        """
        camera, size, ends = self.camera, self.size, self.ends
        reading = replace(self.reading, seconds=None, bytes=None, missing="error", client=False)

        def again(scene: Scene, keep: Keeper, pixel: tuple[int, int] | None) -> list[NDArray[np.float64]]:
            return BrickedFrame(scene, camera, size, keep, reading, ends).found(pixel)

        return again
