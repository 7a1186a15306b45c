"""``make demo-cluster``: a local Dask cluster renders a pyramid that is read as it is seen, and stops."""

from __future__ import annotations

import logging
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import wvr

OUTPUT = Path("out/demo-cluster")
SIZE = (512, 512)


def main(workers: int = 2, samples: int = 256) -> None:
    """Write a volume of so many ``samples`` along each axis as OME-Zarr, find its ranges, and have ``workers``
    render.
    """
    import ngff_zarr
    from distributed import Client, LocalCluster

    OUTPUT.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix="wvr-demo-") as folder:
        store = Path(folder) / "blobs.ome.zarr"
        volume = wvr.datasets.load("blobs", samples)
        image = ngff_zarr.to_ngff_image(volume.numpy(), dims=["z", "y", "x"], scale=dict.fromkeys("zyx", 0.5))
        pyramid = ngff_zarr.to_multiscales(image, scale_factors=[2, 4], chunks=32)
        ngff_zarr.to_ngff_zarr(str(store), pyramid, version="0.5")
        print(f"{store.name}: {volume}")
        quiet = {"dashboard_address": ":0", "silence_logs": logging.CRITICAL}
        cluster = LocalCluster(n_workers=workers, threads_per_worker=1, **quiet)
        with cluster, Client(cluster) as client:
            lazy = wvr.build_ranges(store, client=client)
            tf = wvr.TransferFunction([(0, "navy", 0.0), (110, "teal", 0.0), (150, "gold", 0.05), (255, "white", 0.4)])
            camera = wvr.Camera.fit(lazy, (1, 0.6, 0.4))
            for name, options in (("one process", {"client": False}), (f"{workers} workers", {"client": client})):
                for frame in ("first", "second"):
                    start = perf_counter()
                    shown = wvr.render(lazy, tf, camera, SIZE, background="black", **options)
                    read, total = shown.stats["blocks_read"], shown.stats["bricks"]
                    seconds = perf_counter() - start
                    print(
                        f"{name}, {frame} image: {seconds:.2f} s, {read} blocks read for {total} bricks, errors up to "
                        f"{shown.max_error:.2g}"
                    )
        path = OUTPUT / "blobs.png"
        shown.save(path)
        print(path)


if __name__ == "__main__":
    main()
