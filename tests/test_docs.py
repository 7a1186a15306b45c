"""The pages are true as far as a machine can tell: code runs, links lead somewhere, every public name is documented."""

import csv
import dataclasses
import doctest
import inspect
import json
import re
from pathlib import Path

import pytest

import wvr
from wvr import cli

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(page for page in (ROOT / "docs").rglob("*.md"))]


def blocks(page: Path) -> list[str]:
    return re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S)


# The readme's runs below.
@pytest.mark.parametrize("page", [page for page in PAGES[1:] if blocks(page)], ids=lambda page: page.name)
def test_code_runs(page, tmp_path, monkeypatch, threads):
    """With small images where it does not say how large."""
    if page.name == "big-data.md":
        pytest.importorskip("ngff_zarr")  # needs Python 3.11
    monkeypatch.chdir(tmp_path)
    for function in (wvr.render, wvr.Renderer.render):
        assert (512, 512) in function.__defaults__
        small = tuple((128, 96) if one == (512, 512) else one for one in function.__defaults__)
        monkeypatch.setattr(function, "__defaults__", small)
    names: dict = {}  # a page goes on with what it has
    for block in blocks(page):
        exec(compile(block, str(page), "exec"), names)


def test_code_of_the_readme_runs_and_says_how_wrong_it_is(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    first, second, *others = blocks(ROOT / "README.md")
    for example in (first, second):
        exec(compile(example, "README.md", "exec"), names)
        assert (tmp_path / "tree.png").stat().st_size > 10_000 and "Image(512 x 512" in capsys.readouterr().out
        (tmp_path / "tree.png").unlink()
    assert names["image"].max_error <= 1e-3
    for block in others:
        exec(compile(block, "README.md", "exec"), names)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    """To a file that there is and, in a page, to a heading that it has."""
    for link in re.findall(r"\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
        if link.startswith("https://"):
            continue
        name, _, heading = link.partition("#")
        target = page.parent / name if name else page
        assert target.exists(), link
        assert not heading or heading in headings(target), link


def headings(page: Path) -> set[str]:
    """As links name them: in small letters, spaces as hyphens, without other signs."""
    titles = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


NUMBER = re.compile(r"(?<![\w./])-?\d+(?:\.\d+)?(?:e-?\d+)?(?![\d²³])")
TABLES = [
    pytest.param(page, source, table, id=f"{page.name}: {source}")
    for page in PAGES
    for source, table in re.findall(r"<!-- from (.*?) -->\n\n((?:\|.*\n)+)", page.read_text(encoding="utf-8"))
]


BY_CELL = [one for one in TABLES if " by " in str(one.values[1])]


def test_tables_of_studies_are_checked_by_their_cells():
    """Of other files, which have no columns, any number would do."""
    assert not [one.id for one in TABLES if one not in BY_CELL and ".csv" in str(one.values[1])]


def half_unit(number: str) -> float:
    """Half of the last digit that is given, and a little."""
    digits, _, power = number.partition("e")
    return 0.5001 * 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


@pytest.mark.parametrize(("page", "source", "table"), [one for one in TABLES if one not in BY_CELL])
def test_numbers_are_those_of_the_results(page, source, table):
    """Each number of a table is one of the files that it is from, rounded; in per cent, thousands or millions."""
    texts = [(page.parent / name).read_text(encoding="utf-8") for name in source.split()]
    measured = [float(number) for text in texts for number in NUMBER.findall(text)]
    for row in table.splitlines()[2:]:
        for number in NUMBER.findall(row.split("|", 2)[2]):
            near = (abs(float(number) - scale * one) for one in measured for scale in (1, 100, 1e3, 1e-3, 1e-6))
            assert min(near) <= half_unit(number), f"{number} in {row}"


def named(value: str, label: str) -> bool:
    """Whether a row is called by the value of its key: that, or that and more, or the same number."""
    try:
        return float(value) == float(re.split(r"[,: ]", label)[0])
    except ValueError:
        return label == value or label.startswith((f"{value},", f"{value}:", f"{value} ("))


def cell(page: Path, at: str, labels: dict[str, str]) -> dict[str, str]:
    """The row of a file, with its keys as the labels say and, in brackets, other columns as given, or another file."""
    name, *given = re.split(r"[\[\];]+", at.strip())
    name, given = next((one for one in given if ".csv" in one), name), [one for one in given if ".csv" not in one]
    with (page.parent / name.strip()).open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    wanted = dict(one.strip().split("=") for one in given if one.strip())
    rows = [row for row in rows if wanted.items() <= row.items()]
    rows = [row for row in rows if all(named(row[key], label) for key, label in labels.items())]
    found = [row for row in rows if labels.items() <= row.items()] or rows
    assert len(found) == 1, f"{len(found)} rows of {at} have {labels}"
    return found[0]


@pytest.mark.parametrize(("page", "source", "table"), BY_CELL)
def test_numbers_are_those_of_their_cells(page, source, table):
    """``FILE by KEY: A, B*100 | [scene=bonsai] C | -``: in each row of the page, whose first column is the KEY of a row
    of the file, the second has numbers of its columns A and B (B in per cent), the third C of the row that also has the
    scene, the last none that were measured. Keys may be several, ``KEY + KEY``, as many first columns of the page;
    names with commas are in quotation marks. ``[another.csv; scene=bonsai] C`` is of another file.
    """
    file, columns = source.split(" by ", 1)
    keys, columns = columns.split(": ", 1)
    keys = keys.split(" + ")
    for row in table.splitlines()[2:]:
        texts = [text.strip() for text in re.sub(r'[`*"]', "", row).strip()[1:-1].split("|")]
        labels, texts = dict(zip(keys, texts, strict=False)), texts[len(keys) :]
        specs = columns.split(" | ")
        assert len(texts) == len(specs), row
        for text, spec in zip(texts, specs, strict=True):
            where, names = re.fullmatch(r"(\[.*?\] )?(.*)", spec.strip()).groups()
            numbers = NUMBER.findall(text)
            if names == "-" or (not numbers and not text):
                continue
            measured = cell(page, file + (where or ""), labels)
            names = next(csv.reader([names], skipinitialspace=True))
            assert len(numbers) == len(names), f"{text} is not of {names}"
            for number, name in zip(numbers, names, strict=True):
                column, _, factor = name.partition("*")
                value = float(measured[column]) * float(factor or 1)
                assert abs(float(number) - value) <= half_unit(number), f"{number} for {name} = {value} in {row}"


@pytest.mark.parametrize("record", sorted(ROOT.glob("docs/results/*/*/part.json")), ids=lambda path: path.parent.name)
def test_results_are_of_committed_code(record):
    assert not json.loads(record.read_text(encoding="utf-8"))["machine"]["commit"].endswith("-dirty")


def test_every_page_is_in_the_contents():
    contents = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    for page in PAGES[2:]:
        name = page.relative_to(ROOT / "docs").with_suffix("").as_posix()
        assert name == "index" or re.search(rf"^{name}$", contents, re.M), name


def public() -> dict[str, object]:
    """Everything that ``wvr`` exports, and public methods and properties of its classes, by name."""
    found: dict[str, object] = {}
    for name in wvr.__all__:
        thing = getattr(wvr, name)
        found[name] = thing
        for member, value in vars(thing).items() if inspect.isclass(thing) else ():
            if not member.startswith("_") and (callable(value) or isinstance(value, property | classmethod)):
                found[f"{name}.{member}"] = value
    return found


# What an integrator tells the renderer; documented once, in the protocol.
PROTOCOL = ("rule", "steps", "shortest", "order", "termination")


def test_every_public_name_is_documented():
    assert set(wvr.__all__) <= set(dir(wvr))
    without = [n for n, thing in public().items() if not inspect.getdoc(thing) and n.split(".")[-1] not in PROTOCOL]
    assert not without


def test_parameters_are_documented():
    """Those of every exported function and class are in its docstring, by name."""
    missing = []
    for name in wvr.__all__:
        thing = getattr(wvr, name)
        # An exception, of anything, and what is made as an Image is.
        if callable(thing) and thing not in (wvr.Cancelled, wvr.BoundedImage):
            text = inspect.getdoc(thing) or ""
            for parameter in inspect.signature(thing).parameters.values():
                if not re.search(rf"\b{parameter.name}\b", text):
                    missing.append(f"{name}({parameter.name})")
    assert not missing


def test_examples_in_docstrings_run():
    modules = {inspect.getmodule(getattr(wvr, name)) for name in wvr.__all__}
    tried = [doctest.testmod(module) for module in modules if module is not None]
    assert sum(result.failed for result in tried) == 0 and sum(result.attempted for result in tried) >= 5


def test_every_option_of_the_command_line_has_help():
    for command in (cli.render, cli.orbit, cli.view, cli.info, cli.ranges, cli.warm_up, cli.study):
        text = inspect.getdoc(command) or ""
        for name, parameter in inspect.signature(command).parameters.items():
            group = type(parameter.default)
            if dataclasses.is_dataclass(group):  # of options that several commands have
                names, described = [field.name for field in dataclasses.fields(group)], inspect.getdoc(group) or ""
            else:
                names, described = [name], text
            for one in names:
                assert re.search(rf"^{one}$", described, re.M), f"{command.__name__}: {one}"


def test_the_version_is_one():
    citation = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    project = re.search(r'^version = "(.+)"$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert citation and project and citation[1] == project[1] == wvr.__version__
    assert f"## {wvr.__version__}" in (ROOT / "CHANGELOG.md").read_text()
