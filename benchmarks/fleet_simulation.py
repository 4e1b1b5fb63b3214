"""A city's drives on a simulated cluster: the fleet's own scheduler and Ray engine, on nodes that fail and straggle.

    .venv/bin/python benchmarks/fleet_simulation.py [--only days sweep validation] [--work FOLDER]

Reads the measured costs of docs/scale.json (benchmarks/costs.py) and writes what it finds there, too. The simulation is
the same to the bit for the same costs. `validation` runs small drives for real (the extra `ray`, and the data).
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from cluster_simulation import Day, Drives, Machines, Storage, simulate
from cluster_simulation.day import driver_costs
from cluster_simulation.pictures import draw
from cluster_simulation.validation import validated
from cost_parts.cases import ROOT, cases
from cost_parts.fits import Costs
from costs import FILE, rounded, write

HOUR_S, DAY_S = 3600.0, 86400.0
USUAL = Machines(1000, 2.0, mtbf_s=30 * DAY_S, slow_share=0.02, slow_factor=3.0)
DRIVES = 10_000
SWEEP = {  # drives: nodes and their CPUs
    1_000: ((10, 2.0), (100, 2.0), (1000, 2.0), (3000, 2.0)),
    10_000: ((100, 2.0), (1000, 2.0), (3000, 2.0), (1000, 16.0)),
    100_000: ((1000, 16.0),),
}
VALIDATED = (
    *("street map 20", "street map 40", "06 map 17", "06 map 34", "06 map 51"),
    *("masks 70/6 map", "masks 70/6 slam", "masks 140/24 map", "masks 140/24 localize", "masks 280/12 map"),
)
GB = 1e9
PARTS = 120  # of the makespan, in the picture


def days(costs: Costs) -> Iterator[tuple[str, Day]]:
    """10,000 drives on 1,000 nodes: one trouble after the other, then all, then the shared storage."""
    usual = replace(USUAL, start_s=costs.driver["worker_start_s"])
    perfect = replace(usual, mtbf_s=float("inf"), slow_share=0.0, start_s=0.0)
    drives, smooth = costs.drives(DRIVES), costs.drives(DRIVES, straggler_sigma=0.0)
    driver = driver_costs(costs.driver, DRIVES, usual.nodes * usual.cpus)
    yield "nothing fails, driver and storage cost nothing", Day(smooth, perfect)
    yield "and the driver as measured", Day(smooth, perfect, driver)
    yield "and stragglers, 2% of the nodes three times slower", Day(drives, replace(usual, mtbf_s=float("inf")), driver)
    yield "and every node lost once in 30 days: a usual day", Day(drives, usual, driver)
    yield "a usual day, the longest drives are listed first", Day(longest_first(drives), usual, driver)
    outage = replace(usual, outage_at_s=HOUR_S / 4, outage_share=0.2, mtbf_s=DAY_S)
    yield "a bad day: nodes live a day, 20% are lost after 15 minutes", Day(drives, outage, driver)
    yield "spot nodes that live two hours", Day(drives, replace(usual, mtbf_s=2 * HOUR_S), driver)
    yield "the same, five retries", Day(drives, replace(usual, mtbf_s=2 * HOUR_S), driver, retries=5)
    for total in (10.0, 3.0, 1.0):
        storage = Storage(total * GB, 0.125 * GB)
        yield (
            f"a usual day, images from one storage of {total:g} GB/s",
            Day(drives, replace(usual, storage=storage), driver),
        )


def longest_first(drives: Drives) -> Drives:
    """The same drives in another order of the fleet file."""
    by_length = sorted(drives.tasks.items(), key=lambda item: -sum(task.compute_s for task in item[1].values()))
    return replace(drives, tasks=dict(by_length))


def sweep(costs: Costs) -> Iterator[tuple[str, Day]]:
    """Usual days of clusters of all sizes."""
    usual = replace(USUAL, start_s=costs.driver["worker_start_s"])
    for count, clusters in SWEEP.items():
        drives = costs.drives(count)
        for nodes, cpus in clusters:
            driver = driver_costs(costs.driver, count, nodes * cpus)
            yield f"{nodes} x {cpus:g}: {count}", Day(drives, replace(usual, nodes=nodes, cpus=cpus), driver)


def row_of(name: str, day: Day) -> dict[str, Any]:
    """A day's figures."""
    began_s = time.perf_counter()
    report = simulate(day)
    row = {
        "name": name,
        "drives": len(report.results),
        "nodes": day.machines.nodes,
        "cpus": day.machines.cpus,
        "makespan_s": report.makespan_s,
        "most_done_s": report.most_done_s,
        "utilization": report.utilization,
        "wasted": report.wasted,
        "tasks_lost": report.losses,
        "driver_busy": report.driver_busy,
        "drive_p50_s": report.drive_p50_s,
        "drive_p99_s": report.drive_p99_s,
        "drives_failed": report.failed,
        "at_work": report.mean_at_work(PARTS),
    }
    print(
        " ",
        {k: rounded(v) for k, v in row.items() if k != "at_work"},
        f"simulated in {time.perf_counter() - began_s:.0f} s",
        flush=True,
    )
    return row


def main() -> None:
    """Simulate, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = ("days", "sweep", "validation")
    parser.add_argument("--only", nargs="+", choices=parts, default=parts)
    parser.add_argument("--work", type=Path, default=ROOT / "benchmarks" / "out" / "costs")
    parser.add_argument("--rounds", type=int, default=2, help="of the validation")
    a = parser.parse_args()
    os.environ["MESHSLAM_RECORDING"] = "0"
    for part in a.only:
        print(f"{part}:", flush=True)
        found = json.loads(FILE.read_text(encoding="utf-8"))
        costs = Costs(found)
        if part == "validation":
            made = {case.name: case for case in cases(a.work / "steps")}
            small = [made[name] for name in VALIDATED]
            rows = validated(small, a.work / "validation", costs.driver, a.rounds)
        else:
            rows = [row_of(name, day) for name, day in (days if part == "days" else sweep)(costs)]
        found[part] = rounded(rows)
        write(found)
    if "days" in found and "sweep" in found:
        draw(found["days"], found["sweep"], ROOT / "docs" / "assets")


if __name__ == "__main__":
    main()
