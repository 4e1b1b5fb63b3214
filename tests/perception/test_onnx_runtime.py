"""ONNX Runtime 1.29 and later keeps a device id and reports what is run: not from here."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import os
from pathlib import Path
from meshslam.perception.onnx_runtime import inference_session
from meshslam.perception.keypoints import finder
inference_session(Path(finder.__file__).parent / "data" / finder.SHIPPED)
print(len(os.listdir("/proc/self/task")))
"""


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are listed under /proc on Linux alone")
def test_a_session_leaves_no_file_in_the_users_folder_and_no_thread_that_reports(tmp_path):
    told = {k: v for k, v in os.environ.items() if not k.startswith(("ORT_", "XDG_")) and k != "CI"}
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**told, "HOME": str(tmp_path), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert [p for p in tmp_path.rglob("*") if "onnxruntime" in p.name or "deviceid" in p.name] == []
    assert int(run.stdout) == 1
