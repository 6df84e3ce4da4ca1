"""Compare labcdp with every truth from outside, and write a page, a table and JSON.

Run ``make validate``, or ``python -m benchmarks.validation --help`` for a part of it.
"""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import scipy

import labcdp
from labcdp.core.result import Result
from labcdp.core.table import Column, Table
from labcdp.output import ResultsFolder
from labcdp.report.files import result_files
from labcdp.report.layout import Card, Page, Section, facts_table

from . import devices, numbers, peers
from .check import Check

COLUMNS = (
    Column("name", "check", meaning="What is compared."),
    Column("truth", "outside truth", meaning="Value known from elsewhere.", digits=6),
    Column("found", "labcdp", meaning="Value that labcdp gives.", digits=6),
    Column("deviation", "deviation", meaning="Distance of the two.", digits=2),
    Column("limit", "limit", meaning="Largest distance that agrees.", digits=2),
    Column("measure", "in", meaning="What deviation and limit are in."),
    Column("verdict", "verdict", meaning="Whether the deviation is within the limit."),
    Column("source", "source", meaning="Where the truth comes from."),
)


def table(part: str, title: str, checks: Sequence[Check]) -> Table:
    """Return the checks of a part as a table."""
    return Table.of_items(part, title, COLUMNS, checks)


def card(one: Table) -> Card:
    """Return how many checks of a part agree."""
    verdicts = list(one["verdict"])
    judged = [verdict for verdict in verdicts if verdict in ("agrees", "deviates")]
    if not judged:
        return Card(one.title, "stated" if "stated" in verdicts else "not run")
    agree = judged.count("agrees")
    return Card(
        one.title, f"{agree} of {len(judged)}", "within the limit", state="good" if agree == len(judged) else "bad"
    )


def validated(parts: dict[str, tuple[str, Callable[[], Iterable[Check]]]]) -> tuple[Table, ...]:
    """Run the parts one after another."""
    tables = []
    for name, (title, run) in parts.items():
        start = datetime.now(UTC)
        tables.append(table(name, title, list(run())))
        seconds = (datetime.now(UTC) - start).total_seconds()
        print(f"{title}: {card(tables[-1]).value} ({seconds:.0f} s)", flush=True)
    return tuple(tables)


def main() -> None:
    """Run all, or the parts that are named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", help="a part; may be given several times")
    parser.add_argument(
        "--emva", type=Path, default=os.environ.get("LABCDP_EMVA_DATA"), help="folder of the reference sets"
    )
    parser.add_argument(
        "--calibrations",
        type=int,
        default=20,
        help="of each world: 20 take 5 processor minutes and find gross errors only, 400 tell 95 %% from 97 %%",
    )
    parser.add_argument("--seeds", type=int, default=30, help="of the thesis' rows")
    parser.add_argument("--output", type=Path, default=Path("build/validation"))
    given = parser.parse_args()
    emva = Path(given.emva) if given.emva else None
    parts: dict[str, tuple[str, Callable[[], Iterable[Check]]]] = {
        "closed_forms": ("Closed forms", numbers.closed_forms),
        "exact_arithmetic": ("Exact arithmetic", numbers.exact_arithmetic),
        "reference_sets": ("EMVA 1288 reference sets", partial(numbers.reference_sets, emva)),
        "thesis": ("The 2018 thesis", partial(numbers.thesis, given.seeds)),
        "prediction": ("Prediction against brute force", numbers.prediction),
        "coverage": ("Coverage of 95 % intervals", partial(numbers.coverage, given.calibrations)),
        "tracking": ("Tracking", numbers.tracking),
        "grabbing": ("Simulated camera, Aravis and losses", devices.grabbing),
        "speeds": ("Speed and accuracy beside others", peers.speeds),
    }
    if unknown := set(given.only or ()) - set(parts):
        parser.error(f"there is no part {', '.join(sorted(unknown))}: choose from {', '.join(parts)}")
    tables = validated({name: part for name, part in parts.items() if not given.only or name in given.only})
    facts = {
        "Date": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        "labcdp": labcdp.__version__,
        "Python": platform.python_version(),
        "NumPy, SciPy, OpenCV": f"{np.__version__}, {scipy.__version__}, {cv2.__version__}",
        "Aravis' programs": devices.aravis_version(),
        "Machine": f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()} {platform.release()}",
    }
    title = f"Validation of labcdp {labcdp.__version__}"
    result = Result("validate", title, tables, configuration=facts, simulated=True)
    sections = [Section(one.title, (one,)) for one in tables]
    provenance = Section("Date and versions", (facts_table(facts.items()),))
    page = Page("validation", title, facts["Date"], cards=tuple(map(card, tables)), sections=[provenance, *sections])
    with ResultsFolder(given.output, "validate", force=True) as folder:
        folder.add(result_files(result, page))
    print(f"Report: {given.output / 'report.html'}")


if __name__ == "__main__":
    main()
