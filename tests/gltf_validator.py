"""Khronos' glTF validator, from npm, as the tests ask it."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
PACKAGES = HERE.parent / ".node"


def validated(file):
    """Errors and warnings that the validator has, as texts."""
    if shutil.which("node") is None or not (PACKAGES / "node_modules" / "gltf-validator").is_dir():
        reason = "no gltf-validator: `make test` installs it where node and npm are"
        pytest.fail(reason) if os.environ.get("MESHSLAM_REQUIRE_DATA") == "1" else pytest.skip(reason)
    command = ["node", HERE / "node" / "validate_gltf.js", PACKAGES, file]
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=True)
    messages = json.loads(done.stdout)["issues"]["messages"]
    return [f"{m['code']} at {m.get('pointer')}: {m['message']}" for m in messages if m["severity"] < 2]
