"""The README's example runs as it stands."""

import re
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"


def test_example_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (example,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.S)
    exec(compile(example, "README.md", "exec"), {})
    assert (tmp_path / "tree.png").stat().st_size > 10_000 and "Image(512 x 512" in capsys.readouterr().out


def test_pictures_are_there():
    for picture in re.findall(r"!\[[^]]*]\(([^)]*)\)", README.read_text(encoding="utf-8")):
        assert (README.parent / picture).is_file()
