"""Deliberate faults: that a fault is caught, and that one that is not is said."""

import pytest

from studies import faults

from .helpers import rows_of


def test_a_fault_is_caught_and_one_that_is_none_is_said(tmp_path, monkeypatch):
    fault = next(one for one in faults.FAULTS if one.file == "wvr/transfer/simplify.py")
    monkeypatch.setattr(faults, "FAULTS", (fault,))
    assert "All of 1 faults" in faults.faults(tmp_path, False)
    assert rows_of(tmp_path, "faults")[0]["caught"] == "yes"
    # That tests are run, and that one fails where it should, was seen above.
    monkeypatch.setattr(faults, "fails", lambda test, folder: False)
    with pytest.raises(AssertionError, match="no test caught: control points of jumps"):
        faults.faults(tmp_path, False)
