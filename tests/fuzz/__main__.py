"""``python -m tests.fuzz``: runs cases of all kinds in turn until the time is up, and repeats single ones."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from itertools import count, islice
from pathlib import Path
from typing import Any

from .run import LIMITS, run

# How many cases of a kind come before the next kind's turn.
TURN = {"files": 4000, "arguments": 1000, "scenes": 4}


NEW: dict[str, Any] = {"next": {}, "counts": {}, "subjects": {}, "found": []}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", nargs="?", choices=sorted(LIMITS), help="of the cases; by default all, in turn")
    parser.add_argument("number", nargs="?", type=int, help="of one case, to be repeated")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument(
        "--state", type=Path, default=Path("out/fuzz.json"), help="where it goes on, and what was found"
    )
    given = parser.parse_args()
    if given.number is not None:
        for found in run(given.kind, [given.number]):
            print(found.outcome, found.note)
        return 0
    state = json.loads(given.state.read_text()) if given.state.exists() else json.loads(json.dumps(NEW))
    end = time.monotonic() + 60 * given.minutes
    kinds = [given.kind] if given.kind else list(TURN)
    # A worker lasts as long as its cases go on.
    runs = {kind: run(kind, count(state["next"].get(kind, 0))) for kind in kinds}
    while time.monotonic() < end:
        for kind in kinds:
            counts = Counter(state["counts"].get(kind, {}))
            subjects = Counter(state["subjects"].get(kind, {}))
            for found in islice(runs[kind], TURN[kind]):
                counts[found.outcome] += 1
                subjects[found.subject] += 1
                state["next"][kind] = found.number + 1
                if found.outcome != "right":
                    state["found"].append(found)
                    print(f"{kind} {found.number}: {found.note if ':' in found.note else found.outcome}", flush=True)
                if time.monotonic() > end:
                    break
            state["counts"][kind], state["subjects"][kind] = counts, subjects
            given.state.parent.mkdir(parents=True, exist_ok=True)
            given.state.write_text(json.dumps(state))
            if time.monotonic() > end:
                break
    for kind in kinds:
        print(f"{kind}: {state['next'].get(kind, 0)} cases, {dict(state['counts'].get(kind, {}))}")
        for subject, number in sorted(state["subjects"].get(kind, {}).items()):
            print(f"    {subject or kind}: {number}")
    return 1 if state["found"] else 0


if __name__ == "__main__":
    sys.exit(main())
