"""The study of enclosures, in small; and that it fails where a pixel is beyond its bound."""

import pytest

from studies import enclosure

from .helpers import rows_of


def test_pieces_and_rays(results):
    folder = results("enclosure")
    for part in ("rays", "pieces"):
        rows = rows_of(folder / part, part)
        assert rows and all(0 < row["worst error / bound"] < 1 for row in rows)
    assert not (folder / "rays" / "over.csv").exists()


def test_a_pixel_beyond_its_bound_is_listed(tmp_path, monkeypatch):
    monkeypatch.setattr(enclosure, "KINDS", {"masks": enclosure.KINDS["masks"]})
    monkeypatch.setattr(enclosure, "errors", lambda pixel, truth: (1.5, 1.5))
    with pytest.raises(AssertionError, match="further off than their bound"):
        enclosure.rays(tmp_path, quick=True)
    assert rows_of(tmp_path, "over")[0]["kind"] == "masks"
