"""``wvr study``: what wvr's claims rest on, repeated."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter


def study(
    *names: str,
    every: Annotated[bool, Parameter(name="--all", negative="")] = False,
    quick: Annotated[bool, Parameter(negative="")] = False,
    resume: Annotated[bool, Parameter(negative="")] = False,
    record: Annotated[bool, Parameter(negative="")] = False,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
) -> int:
    """Repeat the studies that wvr's claims rest on, in a checkout; without a name, list them.

    Parameters
    ----------
    names
        The studies to run; NAME/PART is one part of a study, by the name of its folder.
    every
        Run all.
    quick
        Small scenes and generated volumes: shows that the studies work, within minutes.
    resume
        Keep the parts that were finished by the same code on the same machine.
    record
        Also copy what is in the folder and was not made with --quick to docs/results, for the documentation.
    output
        Folder for tables, charts and report.html; by default out/studies, with --quick out/studies-quick.
    """
    if every and names:
        raise ValueError(f"give names or --all, not both, got {' '.join(names)}")
    runner = _studies()
    if not every and not names:
        for known in runner.find():
            print(f"{known.name}: {known.title}")
            for part in known.parts.values():
                print(f"    {part.title}: {part.what}")
        return 0
    out = Path("out/studies-quick" if quick else "out/studies") if output is None else output
    failed = runner.run(runner.find(names or runner.NAMES), out, quick, resume)
    print(out / "report.html")
    if record:
        print(runner.record(out))
    for reason in failed:
        print(f"wvr: failed: {reason}", file=sys.stderr)
    return 1 if failed else 0


def _studies() -> Any:
    """The module that runs studies. They are part of a checkout, not of what is installed."""
    import wvr

    root = Path(wvr.__file__).resolve().parents[1]
    if not (root / "studies" / "runner.py").exists():
        raise FileNotFoundError(
            "the studies are not installed with wvr; in a checkout of its repository, run make studies"
        )
    sys.path.insert(0, str(root))
    from studies import runner

    return runner
