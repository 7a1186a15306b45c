"""The report: one HTML file with all tables, charts and findings, that needs no network and nothing beside it."""

from __future__ import annotations

import base64
import json
from collections import Counter
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

from wvr.files import write_text

from .base.rows import text
from .base.study import Part, Study

SMALL = "; quick: small scenes, which show only that the study works"
# A longer table is folded.
LONG = 12

STYLE = """
:root { color-scheme: light dark; --ink: #1b1b1b; --page: #fdfdfc; --faint: #666; --line: #ddd; --card: #f2f1ee; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e4e4e2; --page: #161615; --faint: #a0a09c; --line: #3a3a38; --card: #232321; }
}
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--page); margin: 0 auto;
  max-width: 62rem; padding: 1rem; overflow-wrap: anywhere; }
h1, h2, h3 { line-height: 1.25; } h2 { border-top: 2px solid var(--line); padding-top: 1.2rem; margin-top: 3rem; }
a { color: inherit; } nav ul { padding-left: 1.2rem; }
.says, .finding { background: var(--card); border-left: .3rem solid var(--faint); padding: .4rem .8rem;
  margin: .6rem 0; }
.finding { border-color: #009E73; } .failed { border-color: #D55E00; }
.where, .made, caption, figcaption { color: var(--faint); font-size: .85rem; text-align: left; }
.scroll { overflow-x: auto; margin: .8rem 0; }
table { border-collapse: collapse; font-size: .85rem; font-variant-numeric: tabular-nums; overflow-wrap: normal; }
th, td { border-bottom: 1px solid var(--line); padding: .15rem .6rem; text-align: right; vertical-align: bottom; }
th:first-child, td:first-child { text-align: left; } td { white-space: nowrap; }
figure { margin: .8rem 0; } img { max-width: 100%; height: auto; background: #fff; border-radius: .3rem; }
summary { cursor: pointer; }
"""


def write(out: Path, studies: Sequence[tuple[Study, dict[str, dict[str, Any]]]]) -> None:
    """Write ``report.html``.

    Parameters
    ----------
    out
        Folder with the results of the studies' parts.
    studies
        With the records of their parts, by name; empty where a part was not run.
    """
    out.mkdir(parents=True, exist_ok=True)
    shown = [(study, records) for study, records in studies if any(records.values())]
    contents = "".join(f'<li><a href="#{study.name}">{escape(study.title)}</a></li>' for study, _ in shown)
    body = "".join(_study(out, study, records) for study, records in shown)
    page = f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>wvr: the evidence</title><style>{STYLE}</style></head><body>
<h1>wvr: the evidence</h1>
<p>What the papers reported, what wvr measures, and what follows. Sentences marked green are computed from the numbers
below them. All numbers lie beside this file as CSV and JSON, all charts as SVG and PNG.</p>
<nav><ul>{contents}</ul></nav>
{body}</body></html>
"""
    write_text(out / "report.html", page)


def write_page(folder: Path, studies: Sequence[tuple[Study, dict[str, dict[str, Any]]]]) -> Path:
    """Write ``index.md``, the report as a page of the documentation; arguments are those of :func:`write`."""
    lines = [
        "# Evidence",
        "",
        "What the papers reported, what wvr measured, and what follows, computed from the numbers.",
    ]
    for study, records in studies:
        made = [record for record in records.values() if record]
        if not made:
            continue
        most = Counter(map(_how, made)).most_common(1)[0][0]
        lines += ["", f"## {study.title}", "", f"`wvr study {study.name}` on {most}."]
        for part in study.parts.values():
            if record := records[part.name]:
                lines += ["", f"### {part.title}", "", part.what]
                if (how := _how(record)) != most:
                    lines += ["", f"`wvr study {study.name}/{part.name}` on {how}."]
                if claim := study.claim(part.name):
                    lines += ["", f"> {claim['where']}: {claim['says']}"]
                    if "verdict" in claim:
                        lines += ["", f"{claim['verdict'].capitalize()}. {claim['why']}"]
                lines += ["", f"**{record['finding']}**"]
                for name in record["files"]:
                    path = f"{study.name}/{part.name}/{name}"
                    if name.endswith(".png"):
                        lines += ["", f"![{part.title}]({path})"]
                    elif name.endswith(".csv"):
                        lines += ["", f"[{name}]({path})"]
    page = folder / "index.md"
    write_text(page, "\n".join(lines) + "\n")
    return page


def _how(record: dict[str, Any]) -> str:
    """On what, by which commit and when something was measured."""
    facts = record["machine"]
    return f"{facts['cpu']}, {facts['cores']} threads, commit {facts['commit']}, {facts['date'][:10]}"


def _study(out: Path, study: Study, records: dict[str, dict[str, Any]]) -> str:
    machines = {json.dumps(r["machine"] | {"date": 0, "load": 0}): r for r in records.values() if r}
    folder = out / study.name
    parts = [_part(folder / part.name, study, part, records[part.name]) for part in study.parts.values()]
    return (
        f'<h2 id="{study.name}">{escape(study.title)}</h2>'
        + "".join(_machine(record) for record in machines.values())
        + "".join(parts)
    )


def _machine(record: dict[str, Any]) -> str:
    facts = record["machine"]
    devices = ", ".join(f"{alias} {name}" for alias, name in facts["devices"].items())
    versions = ", ".join(f"{name} {facts[name]}" for name in ("wvr", "warp-lang", "numpy", "vtk") if facts.get(name))
    made = (
        f"on {facts['cpu']}, {facts['cores']} threads, {facts['memory_gib']} GiB; devices: {devices}; "
        f"Python {facts['python']}, {versions}; commit {facts['commit']}; {facts['date']}"
    )
    small = SMALL if record["quick"] else ""
    return f'<p class="made"><code>{escape(record["command"])}</code> {escape(made + small)}</p>'


def _part(folder: Path, study: Study, part: Part, record: dict[str, Any]) -> str:
    title = f"<h3>{escape(part.title)}</h3><p>{escape(part.what)}</p>"
    if claim := study.claim(part.name):
        title += f'<p class="says"><span class="where">{escape(claim["where"])}:</span> {escape(claim["says"])}</p>'
        if "verdict" in claim:
            title += f"<p>{escape(claim['verdict'].capitalize())}. {escape(claim['why'])}</p>"
    if not record:
        return title + "<p>Not run.</p>"
    if "error" in record:
        return title + f'<p class="finding failed">Failed: {escape(record["error"])}</p>'
    results = [_result(folder / name) for name in record["files"]]
    took = f'<p class="made">{record["seconds"]:.0f} s</p>'
    return f'{title}<p class="finding">{escape(record["finding"])}</p>{"".join(results)}{took}'


def _result(path: Path) -> str:
    """A table or a chart; "" for a file that is another one's twin."""
    if path.suffix == ".json":
        return _table(json.loads(path.read_text(encoding="utf-8")))
    if path.suffix == ".png":
        # Lines are smaller as SVG, pictures as PNG.
        images = [image for image in (path, path.with_suffix(".svg")) if image.exists()]
        smallest = min(images, key=lambda image: image.stat().st_size)
        kind = "svg+xml" if smallest.suffix == ".svg" else "png"
        data = base64.b64encode(smallest.read_bytes()).decode()
        return f'<figure><img loading="lazy" alt="{escape(path.stem)}" src="data:image/{kind};base64,{data}"></figure>'
    return ""


def _table(result: dict[str, Any]) -> str:
    rows = result["rows"]
    columns = list(dict.fromkeys(key for row in rows for key in row))
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(text(row.get(column)))}</td>" for column in columns) + "</tr>" for row in rows
    )
    table = f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
    caption = f"{escape(result['title'])}"
    if len(rows) <= LONG:
        return f'<p class="where">{caption}</p>{table}'
    return f'<details><summary class="where">{caption} ({len(rows)} rows)</summary>{table}</details>'
