"""Let another virtual environment find this one's packages, and the package under python/: join_environments.py OTHER.

The wheels of ROS 2 start every interpreter of their environment twice and change what it loads, so that they have an
environment of their own; those of PyTorch are gigabytes. All else that their tests need is here already.
"""

from __future__ import annotations

import subprocess
import sys
import sysconfig
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent / "python"
ASK = "import sysconfig; print(sysconfig.get_path('purelib'))"


def main() -> None:
    """Write a .pth file into the other environment's site-packages; exit code 1 if its Python is another one."""
    other = Path(sys.argv[1]) / "bin" / "python"
    asked = subprocess.run([other, "-c", ASK], capture_output=True, text=True, check=True).stdout.strip()
    here, there = Path(sysconfig.get_path("purelib")), Path(asked)
    if here.parent.name != there.parent.name:
        sys.exit(f"{other} is {there.parent.name}, this is {here.parent.name}: make both with the same PYTHON")
    (there / "meshslam-environment.pth").write_text(f"{PACKAGE}\n{here}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
