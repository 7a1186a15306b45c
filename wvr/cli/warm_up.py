"""``wvr warm-up``: compiles kernels ahead."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

from .stages import Stages


def warm_up(
    *,
    shadows: Annotated[bool, Parameter(negative="")] = False,
    dtype: Annotated[list[str] | None, Parameter(negative="")] = None,
    device: str | None = None,
) -> None:
    """Compile what will be needed, so that the first image does not wait for it.

    Parameters
    ----------
    shadows
        With shadows, too.
    dtype
        Of samples; may be given several times. By default uint8, int16 and float32.
    device
        cpu, cuda:0, ...; by default CUDA where there is one.
    """
    import wvr

    with Stages() as stage:
        stage("compiling")
        kinds = ("uint8", "int16", "float32") if dtype is None else tuple(dtype)
        done = wvr.warm_up(dtype=kinds, device=device)
        if shadows:
            done += wvr.warm_up(True, True, dtype=kinds, device=device)
    for line in done:
        print(line)
