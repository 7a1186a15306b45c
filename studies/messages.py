"""``python -m studies.messages``: what the workers of a cluster send each other for one image, counted and simulated.

Images of groups of bricks are rendered of a real volume at 4096 x 4096 pixels, their bytes counted as they are and as
they compress, and extrapolated to clusters of any size: groups a worker, depth of the reduction, bytes that a worker
sends and that the client gets.
"""

from __future__ import annotations

import pickle
import zlib
from math import ceil, log
from pathlib import Path

import numpy as np

import wvr
from wvr.bricks.brick import Brick, Caster
from wvr.bricks.cluster import ARITY
from wvr.bricks.grid import Bricks, in_order
from wvr.bricks.partial import Partial
from wvr.files import write_text
from wvr.keep import Keeper
from wvr.launch import get_device
from wvr.scene import Scene

PIXELS = 4096
WORKERS = (4, 32, 256, 1000)
OUTPUT = Path("docs/results/messages/messages.txt")


def counted(along: int) -> tuple[float, float, float]:
    """Of a volume in ``along``^3 groups: share of pixels, MB of an image of a group, and MB compressed; means."""
    volume = wvr.datasets.load("blobs", 96)
    tf = wvr.TransferFunction([(0, "navy", 0.0), (90, "teal", 0.0), (150, "gold", 0.02), (255, "white", 0.1)])
    camera = wvr.Camera.fit(volume, (1, 0.6, 0.4))
    nothing = dict.fromkeys(("lighting", "shadows", "termination", "background", "segmentation"))
    scene = Scene(volume, tf, wvr.Certified(1 / 256), precision="auto", skip_empty=True, clips=(), **nothing)
    bricks = Bricks.regular(volume.dimensions, (ceil(95 / along),) * 3)
    keep = Keeper(get_device("cpu"))
    caster = Caster(scene, camera, (PIXELS, PIXELS), bricks, keep)
    found = []
    # Every few, from the front to the back.
    order = in_order(bricks, volume, camera)
    for index in order[:: max(1, len(order) // 4)]:
        rect = caster.footprint(index)
        if rect is None:
            continue
        low, high = bricks.box(index)
        partial = Partial.nothing(rect, caster.bounded)
        caster.cast(index, Brick(volume.region(low, high), low, volume), partial, rect)
        partial = partial.rounded(1.0)
        raw = len(pickle.dumps(partial, protocol=5))
        arrays = (partial.rgbt, partial.bound, partial.samples)
        packed = sum(len(zlib.compress(np.ascontiguousarray(array).tobytes(), 1)) for array in arrays)
        found.append((partial.through.size / PIXELS**2, raw / 1e6, packed / 1e6))
    return tuple(np.mean(found, axis=0).tolist())


def simulated(workers: int) -> str:
    """A row of the table: so many workers, with four groups each."""
    groups = 4 * workers
    along = round(groups ** (1 / 3))
    share, raw, packed = counted(along)
    depth = ceil(log(groups, ARITY))
    # On each level of the tree a worker that composes gets all but its own; footprints grow fourfold and are eight
    # times fewer, so that bytes halve from level to level.
    total, level = 0.0, groups * raw
    for _ in range(depth):
        total += level * (ARITY - 1) / ARITY
        level = max(level / 2, PIXELS**2 * 24 / 1e6)
    last = PIXELS**2 * 24 / 1e6
    each = total / workers
    row = f"| {workers:,} | {along**3:,} | {100 * share:.2g} % | {raw:.3g} | {packed:.3g} | {depth} | {each:.3g} | "
    return row + f"{last:.3g} | {(each + last) / 1250:.2g} |"


def main() -> None:
    """Count, and write the table."""
    head = (
        "| workers | groups | footprint | MB a group | compressed | levels | MB a worker sends | MB to the client | "
        "seconds at 10 Gbit/s |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n"
    )
    table = head + "\n".join(map(simulated, WORKERS)) + "\n"
    print(table)
    OUTPUT.parent.mkdir(parents=True, exist_ok=True)
    write_text(OUTPUT, table)


if __name__ == "__main__":
    main()
