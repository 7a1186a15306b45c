"""The page of recipes shows these files, and counts their lines."""

import re
from pathlib import Path

import pytest

HERE = Path(__file__).parent
PAGE = (HERE.parents[1] / "docs" / "extending.md").read_text(encoding="utf-8")
QUOTES = re.findall(r"\[tests/extending/(\w+\.py)\]\(.*?\):\n\n```py\n(.*?)```", PAGE, re.S)


@pytest.mark.parametrize(("name", "quote"), QUOTES, ids=[name for name, _ in QUOTES])
def test_quotes_are_the_files(name, quote):
    assert quote == (HERE / name).read_text(encoding="utf-8")


def test_all_recipes_are_quoted_and_counted():
    files = sorted(path.name for path in HERE.glob("[!_]*.py") if not path.name.startswith("test_"))
    assert files == sorted(name for name, _ in QUOTES)
    counted = re.findall(r"\| 1 file, (\d+) lines \| 0 \|", PAGE)
    assert [int(count) for count in counted] == [quote.count("\n") for _, quote in QUOTES]


def test_recipes_use_nothing_private():
    for name, text in QUOTES:
        assert re.search(r"^from wvr", text, re.M), name
        assert not re.search(r"[. ]_[a-z]", text), name
