import os
import subprocess
import sys
from pathlib import Path

import pytest

PROBE = """
from meshslam.cli.app import one_blas_thread
one_blas_thread()
import numpy as np, os
np.ones((600, 600)) @ np.ones((600, 600))
print(len(os.listdir("/proc/self/task")))
"""


def _threads(**chosen):
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    environment |= {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **chosen}
    done = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True, env=environment, check=True)
    return int(done.stdout)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted on Linux")
def test_linear_algebra_has_one_thread_unless_the_user_chose():
    assert _threads() == 1
    assert _threads(OMP_NUM_THREADS="2") == 2
    assert _threads(OPENBLAS_NUM_THREADS="2") == 2
