"""Write the tables of docs/scale.md from the measured costs and simulated days of docs/scale.json.

.venv/bin/python scripts/scale_tables.py [--check]

benchmarks/costs.py and benchmarks/fleet_simulation.py write docs/scale.json. Each table stands between two marks.
`--check` only says whether the page is as the figures make it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "benchmarks"))

from cluster_simulation.day import CARS_A_FRAME, IMAGE_BYTES, STEPS, driver_costs, expected  # noqa: E402
from cost_parts.fits import Costs, fit  # noqa: E402

PAGE, FIGURES = ROOT / "docs" / "scale.md", ROOT / "docs" / "scale.json"
HOUR_S, MB, GB, TB = 3600.0, 1e6, 1e9, 1e12
DRIVES, CITY_CARS = 10_000, 1_000_000
Found = dict[str, Any]


def lines(titles: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table as Markdown."""
    every = [titles, ["---"] * len(titles), *rows]
    return "\n".join(f"| {' | '.join(str(cell) for cell in row)} |" for row in every)


def number(value: float, digits: int = 2) -> str:
    """To so many digits that mean something, without powers of ten."""
    if value == 0:
        return "0"
    from math import floor, log10

    places = max(0, digits - 1 - floor(log10(abs(value))))
    return f"{value:,.{places}f}"


def rows_of(found: Found, command: str, step: str, *, images: bool) -> list[Found]:
    """Measured rows of one kind."""
    steps = found["steps"]["figures"]["steps"]
    return [r for r in steps if (r["command"], r["step"], r["image_bytes"] > 0) == (command, step, images)]


def steps_table(found: Found) -> str:
    """Seconds of a CPU by step."""
    kinds = [
        *(("map", step, True, ("frames", "cars") if step == "map" else ("frames",)) for step in STEPS),
        ("slam", "slam", True, ("frames",)),
        ("localize", "localize", True, ("frames",)),
        *((command, command, False, ("frames", "cars")) for command in ("map", "slam", "localize")),
    ]
    table = []
    for command, step, images, by in kinds:
        rows = rows_of(found, command, step, images=images)
        parts = fit(rows, "cpu_s", by)
        spread = [row["cpu_s"] / expected(parts, row["frames"], row["cars"]) for row in rows]
        table.append(
            [
                f"`{step}`, {'images' if images else 'drawn masks'}",
                number(1e3 * parts["frames"]),
                number(1e3 * parts["cars"]) if "cars" in parts else "",
                number(parts["fixed"]),
                f"{min(spread):.2f} to {max(spread):.2f}",
                number(max(row["peak_mb"] for row in rows), 3),
                number(fit(rows, "read_bytes", ("image_bytes",))["image_bytes"]) if images and command == "map" else "",
                len(rows),
            ]
        )
    titles = ("step", "ms a frame", "ms a car", "s a drive", "measured / fit", "peak MB", "reads an image", "runs")
    return lines(titles, table)


def kept_table(found: Found) -> str:
    """Bytes on disk."""
    runs = found["steps"]["figures"]["runs"]
    with_images = [row for row in runs if row["image_bytes"] and row["command"] == "map"]
    without = [{**row, "bytes": row["bytes"] - row["report_bytes"] - row["mesh_bytes"]} for row in with_images]
    of = {
        "run directory of `map`, with images": fit(with_images, "bytes", ("frames", "cars")),
        "its `report.html`, which holds frames": fit(with_images, "report_bytes", ("frames", "cars")),
        "without report and meshes": fit(without, "bytes", ("frames", "cars")),
    }
    rows = [[name, *(number(f[k] / 1e3) for k in ("frames", "cars", "fixed"))] for name, f in of.items()]
    meshes = sum(row["mesh_bytes"] for row in runs) / sum(row["cars"] for row in runs if row["mesh_bytes"])
    tiles = found["tiles"]["figures"][-1]
    rows.append(["meshes (PLY)", "", number(meshes / 1e3), ""])
    rows.append(["map in tiles", "", number(tiles["bytes_a_car"] / 1e3), ""])
    rows.append(["its index, a tile", "", "", number(tiles["index_bytes"] / tiles["tiles"] / 1e3)])
    return lines(("what", "kB a frame", "kB a car", "kB once"), rows)


def driver_table(found: Found) -> str:
    """Of the fleet's driver."""
    f = found["driver"]["figures"]
    own = {(row["drives"], row["cpus"]): row["task_s"] for row in f["own"]}
    rows = [
        *(
            [f"scheduler and engine, {drives:,} drives on {cpus:,} CPUs", f"{1e3 * took:.2f}", "a task"]
            for (drives, cpus), took in own.items()
        ),
        ["Ray: submit", f"{1e3 * f['ray_submit_s']:.2f}", "a task"],
        [
            "Ray: wait",
            f"{1e3 * f['ray_wait_s']:.2f} + {1e6 * f['ray_wait_reference_s']:.1f} a 1,000 under way",
            "a look",
        ],
        ["Ray: get", f"{1e3 * f['ray_get_s']:.2f}", "a task"],
        [
            "how far workers are",
            f"{1e3 * f['ray_board_s']:.1f} + {1e6 * f['ray_board_row_s']:.1f} a 1,000 under way",
            "twice a second",
        ],
        ["2,000 empty tasks, two CPUs, Ray: processor time of the driver", f"{1e3 * f['ray_driver_s']:.1f}", "a task"],
        ["the same, wall time", f"{1e3 * f['ray_task_s']:.1f}", "a task"],
        ["2,000 empty tasks, two local workers: processor time", f"{1e3 * f['local_driver_s']:.2f}", "a task"],
        ["the same, wall time", f"{1e3 * f['local_task_s']:.1f}", "a task"],
        ["first task of a worker process", f"{1e3 * f['worker_start_s']:,.0f}", "a process"],
        ["reading the fleet file", f"{1e3 * f['read_drive_s']:.1f}", "a drive"],
        ["summary: page, tables, JSON", f"{1e3 * f['summary_drive_s']:.1f}", "a drive"],
    ]
    return lines(("what", "ms", "for"), rows)


def tiles_table(found: Found) -> str:
    """Of a map in tiles."""
    titles = (
        "cars",
        "tiles",
        "opening, s",
        "`near` 30 m, tile not in memory, ms",
        "in memory, ms",
        "`put` of 91 cars, s",
    )
    rows = [
        [
            f"{row['cars']:,}",
            f"{row['tiles']:,}",
            f"{row['open_s']:.3f}",
            f"{1e3 * row['near_cold_s']:.1f}",
            f"{1e3 * row['near_warm_s']:.2f}",
            f"{row['put_s']:.2f}",
        ]
        for row in found["tiles"]["figures"]
    ]
    return lines(titles, rows)


def merging_table(found: Found) -> str:
    """Of merging."""
    f = found["merging"]["figures"]
    named = [(f"{row['drives']} passes of a street", row) for row in f["passes"]]
    rows = [
        [
            name,
            row["pairs"],
            f"{1e3 * row['compare_s'] / row['pairs']:.0f}",
            row["cars"],
            f"{(row['total_s'] - row['compare_s']) / row['cars']:.2f}",
            f"{row['total_s']:.1f}",
        ]
        for name, row in [*named, (f"{f['apart']['drives']} drives of different streets", f["apart"])]
    ]
    return lines(("drives", "pairs", "ms a pair", "cars", "s a car", "s in all"), rows)


def city_table(found: Found) -> str:
    """A day of a city, from the costs."""
    costs, tiles = Costs(found), found["tiles"]["figures"][-1]
    tasks = [steps for steps in costs.drives(DRIVES).tasks.values()]
    seconds = {step: sum(one[step].compute_s for one in tasks) for step in STEPS}
    images = sum(one["detect"].read_bytes for one in tasks)
    frames = images / IMAGE_BYTES
    read = sum(one[step].read_bytes for one in tasks for step in STEPS)
    runs = fit(
        [r for r in found["steps"]["figures"]["runs"] if r["image_bytes"] and r["command"] == "map"],
        "bytes",
        ("frames", "cars"),
    )
    kept = expected(runs, frames, CARS_A_FRAME * frames) + runs["fixed"] * (DRIVES - 1)
    apart = found["merging"]["figures"]["apart"]
    pairs = DRIVES * (DRIVES - 1) / 2
    total_s = sum(seconds.values())
    driver = driver_costs(found["driver"]["figures"], DRIVES, 2000)
    rows = [
        ["frames", f"{frames:,.0f}: {frames / DRIVES:,.0f} a drive in the mean"],
        ["cars seen", f"{CARS_A_FRAME * frames:,.0f}"],
        *(
            [f"`{step}`", f"{took / HOUR_S:,.0f} hours of a CPU ({took / total_s:.0%})"]
            for step, took in seconds.items()
        ),
        ["all of it", f"{total_s / HOUR_S:,.0f} hours of a CPU: {total_s / 86400:,.0f} CPUs that are never idle"],
        [
            "images",
            f"{images / TB:.1f} TB, read {read / images:.0f} times: {read / 86400 / GB:.2f} GB/s in the mean",
        ],
        ["run directories", f"{kept / TB:.2f} TB"],
        [
            "the city",
            f"{CITY_CARS * tiles['bytes_a_car'] / GB:.1f} GB and an index of {tiles['index_bytes'] / MB:.1f} MB",
        ],
        ["`put` of each drive's cars, one after the other", f"{DRIVES * tiles['put_s'] / HOUR_S:.1f} hours"],
        ["the driver, with Ray", f"{DRIVES * 3 * task_s(driver) / HOUR_S:.2f} hours of one thread"],
        [
            "`merge` of all drives at once: every pair",
            f"{pairs * apart['compare_s'] / apart['pairs'] / HOUR_S:,.0f} hours of one thread",
        ],
    ]
    return lines((f"{DRIVES:,} drives a day", "takes"), rows)


def task_s(driver: Any) -> float:  # DriverCosts
    """Of the driver, with 2,000 tasks under way."""
    return driver.task_s + driver.submit_s + driver.wait_s + 2000 * driver.wait_reference_s + driver.get_s


def validation_table(found: Found) -> str:
    """The simulation against reality."""
    rows = []
    for row in found["validation"]:
        own, other = row["own_times_s"], row.get("other_rounds_times_s")
        rows.append(
            [
                row["engine"],
                f"{row['real_s']:.1f}",
                f"{own:.1f} ({own / row['real_s'] - 1:+.1%})",
                f"{other:.1f} ({other / row['real_s'] - 1:+.1%})" if other else "",
            ]
        )
    return lines(("engine", "real, s", "simulated, with this run's task times", "with those of other runs"), rows)


def days_table(found: Found) -> str:
    """Simulated days."""
    rows = [[row["name"], *_day(row)] for row in found["days"]]
    titles = (
        "10,000 drives, 1,000 nodes of 2 CPUs",
        "99% / all done, h",
        "CPUs busy",
        "work lost",
        "tasks lost",
        "driver busy",
    )
    return lines((*titles, "a drive, median / 99%, h", "drives failed"), rows)


def _day(row: Found) -> list[str]:
    return [
        f"{row['most_done_s'] / HOUR_S:.2f} / {row['makespan_s'] / HOUR_S:.2f}",
        f"{row['utilization']:.0%}",
        f"{row['wasted']:.1%}",
        f"{row['tasks_lost']:,}",
        f"{row['driver_busy']:.1%}",
        f"{row['drive_p50_s'] / HOUR_S:.2f} / {row['drive_p99_s'] / HOUR_S:.2f}",
        f"{row['drives_failed']}",
    ]


def sweep_table(found: Found) -> str:
    """Simulated clusters."""
    rows = [
        [f"{row['drives']:,}", f"{row['nodes']:,} x {row['cpus']:g}", *_day(row)]
        for row in sorted(found["sweep"], key=lambda row: (row["drives"], row["nodes"] * row["cpus"]))
    ]
    titles = ("drives", "nodes x CPUs", "99% / all done, h", "CPUs busy", "work lost", "tasks lost", "driver busy")
    return lines((*titles, "a drive, median / 99%, h", "drives failed"), rows)


TABLES: dict[str, Callable[[Found], str]] = {
    "steps": steps_table,
    "kept": kept_table,
    "driver": driver_table,
    "tiles": tiles_table,
    "merging": merging_table,
    "city": city_table,
    "validation": validation_table,
    "days": days_table,
    "sweep": sweep_table,
}


def with_tables(page: str, found: Found) -> str:
    """A page with its tables between their marks."""
    for name, table in TABLES.items():
        begin, end = f"<!-- table {name}: scripts/scale_tables.py -->", f"<!-- end of {name} -->"
        before, rest = page.split(begin)
        page = f"{before}{begin}\n{table(found)}\n{end}{rest.split(end)[1]}"
    return page


def main() -> int:
    """Write, or check."""
    page = PAGE.read_text(encoding="utf-8")
    right = with_tables(page, json.loads(FIGURES.read_text(encoding="utf-8")))
    if right == page:
        return 0
    if "--check" in sys.argv:
        sys.stderr.write("docs/scale.md: the tables are not those of docs/scale.json: scripts/scale_tables.py\n")
        return 1
    PAGE.write_text(right, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
