"""Install a wheel in an empty environment, and run the demo there, without a compiler.

python scripts/try_wheel.py WHEEL. The environment is in a temporary folder; PATH holds its programs alone.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

LARGEST_BYTES = 8 * 1000 * 1000


def installed(wheel: Path, place: Path) -> Path:
    """An environment with the wheel and what it needs, from the package registry; its folder of programs."""
    subprocess.run([sys.executable, "-m", "venv", place], check=True)
    programs = place / ("Scripts" if os.name == "nt" else "bin")
    pip = [programs / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "--only-binary", ":all:", wheel], check=True)
    return programs


def run_alone(programs: Path, *arguments: str | Path) -> str:
    """Run meshslam of an environment where nothing else is found, and not in the checkout."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL"))}
    environment["PATH"] = str(programs)
    command = [programs / "meshslam", *arguments]
    return subprocess.run(command, cwd=programs, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout


def main(wheel: Path) -> int:
    """Say the wheel's size, and what the demo says."""
    size = wheel.stat().st_size
    print(f"{wheel}: {size / 1e6:.1f} MB", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        programs = installed(wheel.resolve(), Path(folder) / "fresh")
        print(run_alone(programs, "demo", "--out", Path(folder) / "demo"))
    return 0 if size <= LARGEST_BYTES else 1


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
