"""Run every test, of the core and of the package, and close with one plain line of counts."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OF_ROS2 = "tests/ros2"  # in an environment of their own: see docs/decisions


def cargo_tests() -> tuple[int, int, int, bool]:
    """Passed, failed, skipped of the core's tests, and whether cargo was content."""
    command = ["cargo", "test", "--release", "--package", "meshslam-core", "--no-fail-fast"]
    run = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    rows = re.findall(r"test result: \w+\. (\d+) passed; (\d+) failed; (\d+) ignored", run.stdout)
    if run.returncode != 0:
        print(run.stdout)
    passed, failed, skipped = (sum(int(row[k]) for row in rows) for k in range(3))
    print(f"core: {passed} passed, {failed} failed, {skipped} skipped", flush=True)
    return passed, failed, skipped, run.returncode == 0


def python_tests(python: str, arguments: list[str]) -> tuple[int, int, int, bool]:
    """Passed, failed, skipped of the package's tests by an interpreter, and whether pytest was content."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        workers = ["-n", str(min(4, os.cpu_count() or 1)), "--dist", "loadfile"]  # what a file sets up is made once
        command = [python, "-m", "pytest", *workers, "--durations=25", f"--junitxml={report}", *arguments]
        code = subprocess.run(command, cwd=ROOT, check=False).returncode
        suite = ET.parse(report).getroot().find("testsuite") if report.exists() else None
    if suite is None:
        return 0, 1, 0, False
    total, skipped = int(suite.get("tests", 0)), int(suite.get("skipped", 0))
    failed = int(suite.get("failures", 0)) + int(suite.get("errors", 0))
    return total - failed - skipped, failed, skipped, code == 0


def main() -> int:
    """Run all; exit code 1 if anything failed."""
    chosen = sys.argv[1:]
    parts = [cargo_tests(), python_tests(sys.executable, [*chosen, f"--ignore={OF_ROS2}"])]
    if not chosen:
        print("in .venv-ros2:", flush=True)
        parts.append(python_tests(str(ROOT / ".venv-ros2" / "bin" / "python"), [OF_ROS2]))
    passed, failed, skipped = (sum(part[k] for part in parts) for k in range(3))
    fine = all(part[3] for part in parts)
    print(f"{passed} passed, {failed if fine else max(1, failed)} failed, {skipped} skipped")
    return 0 if fine and passed else 1


if __name__ == "__main__":
    sys.exit(main())
