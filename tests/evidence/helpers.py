"""Rows of recorded tables."""

import json
from pathlib import Path


def rows_of(folder: Path, name: str) -> list[dict]:
    return json.loads((folder / f"{name}.json").read_text())["rows"]
