"""The house: which room may ask which, how long files and lists of parameters are, and who knows whom."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

import wvr
from wvr import cli
from wvr.cuts.base import Clip
from wvr.integrators import Integrator
from wvr.light.lights import Light

ROOT = Path(__file__).parents[1]
# In the order that they may ask each other: a room those before it.
ROOMS = ("transfer", "field", "cuts", "light", "integrators")
# What the rooms are for, and they may not ask.
ROOF = ("scene", "frame", "raycast", "probe", "renderer", "scattering", "cli", "__init__", "__main__")
# What is made of all of it, of whom only these may ask: images in bricks, and whoever shows them.
GUESTS = {
    "bricks": {"bricks", "cli", "renderer", "sources", "__init__"},
    "viewer": {"viewer", "cli", "__init__"},
}
FILES = sorted(path for house in ("wvr", "kernels") for path in (ROOT / house).rglob("*.py"))
TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}
every_file = pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOT).as_posix())


def module_of(path: Path) -> tuple[str, ...]:
    """As it is imported: kernels are installed in ``wvr``."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts[:-1] if parts[-1] == "__init__" else parts
    return parts if parts[0] == "wvr" else ("wvr", *parts)


MODULES = {module_of(path): path for path in FILES}


def imports(path: Path, inside: bool = True) -> Iterator[tuple[str, ...]]:
    """Modules of the house that a file imports at run time, also ``inside`` of functions."""

    def statements(node: ast.AST) -> Iterator[ast.Import | ast.ImportFrom]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
                yield from (found for other in child.orelse for found in statements(other))
            elif isinstance(child, ast.Import | ast.ImportFrom):
                yield child
            elif inside or not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
                yield from statements(child)

    here = module_of(path) if path.name == "__init__.py" else module_of(path)[:-1]
    for statement in statements(TREES[path]):
        if isinstance(statement, ast.Import):
            found = [tuple(name.name.split(".")) for name in statement.names]
        else:
            base = here[: len(here) + 1 - statement.level] if statement.level else ()
            base = (*base, *(statement.module.split(".") if statement.module else ()))
            # What is imported from a package may be a module of it.
            found = [(*base, name.name) if (*base, name.name) in MODULES else base for name in statement.names]
        yield from (module for module in found if module[0] in ("wvr", "kernels"))


def room_of(module: tuple[str, ...]) -> str | None:
    rest = module[2:] if module[:2] == ("wvr", "kernels") else module[1:]
    return rest[0] if rest and rest[0] in ROOMS else None


def on_roof(module: tuple[str, ...]) -> bool:
    rest = module[2:] if module[:2] == ("wvr", "kernels") else module[1:]
    return not rest or rest[0] in ROOF or module[1] in GUESTS


def test_imports_are_found():
    """Of a file whose imports are known."""
    found = set(imports(ROOT / "wvr/integrators/exact.py"))
    assert {("wvr", "keep"), ("wvr", "integrators", "base")} <= found and ("wvr", "scene") not in found
    found = set(imports(ROOT / "kernels/cuts/volumes.py"))
    assert {("wvr", "kernels", "field", "walk"), ("wvr", "kernels", "cuts", "shapes")} <= found


@every_file
def test_no_property_has_a_lock_for_all_objects(path):
    """As those of functools have up to Python 3.11."""
    imported = re.search(r"^\s*(from functools import .*\bcached_property|import functools)\b", path.read_text(), re.M)
    assert not imported or path.name == "cached.py"


@every_file
def test_kernels_import_kernels_alone(path):
    if path.is_relative_to(ROOT / "kernels"):
        assert not [module for module in imports(path) if module[:2] != ("wvr", "kernels")]


@every_file
def test_a_room_imports_only_rooms_before_it(path):
    """Neither itself nor through what it imports."""
    own = room_of(module_of(path))
    if own is None:
        return
    ways = {module_of(path): ""}
    new = [module_of(path)]
    while new:
        asking = new.pop()
        for module in imports(MODULES[asking]):
            way = f"{ways[asking]} -> {'.'.join(module)}"
            room = room_of(module)
            assert not on_roof(module), way
            assert room is None or ROOMS.index(room) <= ROOMS.index(own), way
            if module not in ways:
                ways[module] = way
                new.append(module)


@every_file
def test_guests_are_asked_by_few(path):
    own = module_of(path)[1:] or ("__init__",)
    asked = {module[1] for module in imports(path) if module[0] == "wvr" and len(module) > 1}
    assert not [guest for guest in GUESTS if guest in asked and own[0] not in GUESTS[guest]]


@pytest.mark.parametrize("house", ["wvr", "kernels"])
def test_no_modules_import_each_other(house):
    """When they are imported; packages stand for what they import themselves."""
    asks = {module_of(path): set(imports(path, inside=False)) & MODULES.keys() for path in FILES}
    done: set[tuple[str, ...]] = set()

    def visit(module, way):
        assert module not in way, " imports ".join(".".join(one) for one in (*way[way.index(module) :], module))
        if module not in done:
            for other in sorted(asks[module] - {module}):
                visit(other, [*way, module])
            done.add(module)

    for module in asks:
        if (module[:2] == ("wvr", "kernels")) == (house == "kernels"):
            visit(module, [])


@every_file
def test_kernels_are_told_apart_by_their_numbers(path):
    """Warp asks by floats in single precision whether a kernel is another: of one that is 0 or infinite there a change
    is not seen, and what was compiled before goes on. Typed constants are asked for as they are.
    """
    if path.is_relative_to(ROOT / "kernels"):
        numbers = vars(import_module(".".join(module_of(path))))
        floats = {name: number for name, number in numbers.items() if type(number) is float and number}
        assert not [name for name, number in floats.items() if not 1e-37 < abs(number) < 1e38]


@every_file
def test_files_are_no_longer_than_can_be_overlooked(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 500


def test_functions_have_few_parameters():
    """But those that users call by name, and the structs of dataclasses."""
    public = {name for name in wvr.__all__ if inspect.isroutine(getattr(wvr, name))}
    classes = {name for name in wvr.__all__ if inspect.isclass(getattr(wvr, name))}
    named = (cli.render, cli.orbit, cli.view, cli.info, cli.ranges, cli.warm_up, cli.study)
    commands = {command.__name__ for command in named}
    long = []
    for path, tree in TREES.items():
        owners = {item: node for node in ast.walk(tree) if isinstance(node, ast.ClassDef) for item in node.body}
        for node in ast.walk(tree):
            if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
                continue
            arguments = node.args
            given = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
            number = len([one for one in given if one.arg not in ("self", "cls")])
            name, owner = getattr(node, "name", "lambda"), owners.get(node)
            exempt = owner.name in classes if owner is not None else name in public
            exempt = exempt or (path.is_relative_to(ROOT / "wvr/cli") and name in commands)
            if number > 8 and not exempt:
                long.append(f"{path.relative_to(ROOT)}:{node.lineno} {name} has {number}")
    assert not long, "\n".join(long)


def kinds(base: type) -> set[str]:
    """Names of all classes of a kind."""
    return {base.__name__, *(name for one in base.__subclasses__() for name in kinds(one))}


@pytest.mark.parametrize("file", ["renderer.py", "frame.py", "scene.py"])
@pytest.mark.parametrize("house", ["wvr", "kernels"])
def test_nobody_above_knows_a_kind(house, file):
    """No integrator, clip or light by its name: they say themselves what is to be known of them.

    In the text of docstrings they may be named.
    """
    path = ROOT / house / file
    if not path.exists():
        return
    names = (kinds(Integrator) - {"Integrator"}) | (kinds(Clip) - {"Clip"}) | (kinds(Light) - {"Light"})
    names = {name for name in names if getattr(wvr, name, None) is not None}
    assert {"Exact", "ClipVolume", "Headlight"} <= names
    used = {node.id for node in ast.walk(TREES[path]) if isinstance(node, ast.Name)}
    used |= {node.attr for node in ast.walk(TREES[path]) if isinstance(node, ast.Attribute)}
    used |= {name.name for node in ast.walk(TREES[path]) if isinstance(node, ast.ImportFrom) for name in node.names}
    assert not used & names


@every_file
def test_only_the_field_knows_how_samples_lie(path):
    if "field" in module_of(path):
        return
    text = path.read_text(encoding="utf-8")
    assert not re.findall(r".*\.data\[.*", text)
