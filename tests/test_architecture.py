"""The page on architecture knows the files that there are, and no words that there are not."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
ROWS = {row[0].strip("`/ "): row[1:] for row in (line.strip("| ").split(" | ") for line in PAGE.splitlines())}
# "a march a file", "a family a file"
BY_KIND = (
    *("uniform", "exact", "certified", "adaptive_simpson", "adaptive_preintegrated"),
    *("projection", "extremes", "totals", "isosurface", "reach"),
)


@pytest.mark.parametrize("room", ["transfer", "field", "cuts", "light", "integrators"])
@pytest.mark.parametrize("side", ["kernels", "wvr"])
def test_files_of_rooms_are_said_to_be_for_something(room, side):
    named = set(re.findall(r"`(\w+)`", ROWS[room][side == "wvr"]))
    files = {path.stem for path in (ROOT / side / room).glob("[!_]*.py")}
    by_kind = {name for name in BY_KIND if room == "integrators"}
    assert named <= files <= named | by_kind


def test_files_beside_rooms_are_named():
    named = set(re.findall(r"`(\w+)/?`", PAGE))
    for side in ("kernels", "wvr"):
        missing = {path.stem for path in (ROOT / side).glob("[!_]*") if path.suffix in (".py", "")} - named
        assert missing <= {"preset_points"}, missing


def test_words_are_those_of_the_code():
    code = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "kernels").rglob("*.py"))
    rows = [row.split(" | ")[0][2:] for row in PAGE.split("## Words")[1].splitlines()[4:]]
    assert len(rows) > 40 and rows == sorted(rows)
    assert not [word for row in rows for word in row.split(", ") if not re.search(rf"\b{word}s?\b", code)]
