"""How often labcdp's stated 95 % intervals contain the truth in worlds that differ from its model.

Run ``python benchmarks/worlds [--world NAME ...] [--calibrations N] [--processes N] [--json FILE]``.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parents[1]))

from worlds.bench import calibrate_once
from worlds.catalogue import WORLDS
from worlds.table import as_json, markdown, summarise


def main() -> None:
    """Run the worlds one after another and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--world", action="append", help="only this one; may be given several times, a part of the name is enough"
    )
    parser.add_argument("--calibrations", type=int, default=400, help="of each world")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--json", type=Path, help="write all numbers to this file")
    arguments = parser.parse_args()
    chosen = [w for w in WORLDS if not arguments.world or any(part in w.name for part in arguments.world)]
    summaries = []
    with ProcessPoolExecutor(arguments.processes) as pool:
        for world in chosen:
            outcomes = list(pool.map(partial(calibrate_once, world), range(arguments.calibrations), chunksize=4))
            summaries.append(summarise(world, outcomes))
            print(f"{world.name}: {summaries[-1].coverage}, {summaries[-1].findings}", file=sys.stderr)
            # After each world, so that a run that is ended has those before.
            if arguments.json:
                arguments.json.write_text(json.dumps(as_json(summaries), indent=1) + "\n", encoding="utf-8")
    print(markdown(summaries))


if __name__ == "__main__":
    main()
