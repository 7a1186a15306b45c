"""Chunks of zarr that are packed by Blosc: as long as they say, or refused.

The library believes the length in a chunk's header: of a file that was cut off it reads on beyond what is there, and
returns what the process has in memory as samples.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any

import numcodecs.blosc
import zarr
from numcodecs.compat import ensure_contiguous_ndarray_like
from zarr.codecs import BloscCodec, ShardingCodec


class Checked(numcodecs.blosc.Blosc):
    """Blosc that looks at the length first."""

    codec_id = "blosc"

    @classmethod
    def of(cls, codec: numcodecs.blosc.Blosc) -> Checked:
        return cls(**{name: value for name, value in codec.get_config().items() if name != "id"})

    def decode(self, buf: Any, out: Any = None) -> Any:
        content = memoryview(ensure_contiguous_ndarray_like(buf)).cast("B")
        said = int.from_bytes(content[12:16], "little") if len(content) >= 16 else 16
        if said != len(content):
            raise ValueError(f"a chunk of {len(content):,} bytes says that it has {said:,}: copy it again")
        return super().decode(buf, out)


class CheckedCodec(BloscCodec):
    """The same, of zarr 3."""

    @property
    def _blosc_codec(self) -> Checked:
        return Checked.of(super()._blosc_codec)


def checked(array: Any) -> Any:
    """A zarr array that is read with these."""
    metadata = copy(array.metadata)
    if metadata.zarr_format == 2:
        if not isinstance(metadata.compressor, numcodecs.blosc.Blosc):
            return array
        object.__setattr__(metadata, "compressor", Checked.of(metadata.compressor))
    else:
        object.__setattr__(metadata, "codecs", _checked(metadata.codecs))
    inner = array._async_array
    return zarr.Array(zarr.AsyncArray(metadata, inner.store_path, inner.config))


def _checked(codecs: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple(
        replace(codec, codecs=_checked(codec.codecs))
        if isinstance(codec, ShardingCodec)
        else CheckedCodec.from_dict(codec.to_dict())
        if isinstance(codec, BloscCodec)
        else codec
        for codec in codecs
    )
