#!/usr/bin/env bash
# Ray 2.60.0 reports a lost worker on the driver's standard output, whatever log_to_driver and logging_level say.
#
# `ray.init(log_to_driver=False, logging_level="CRITICAL")` is what the documentation gives to keep logs away from the
# driver, and the logging module of Python writes on standard error. A worker process that ends in the middle of a task,
# here by a signal that the task sends to itself, raises WorkerCrashedError in the driver, as it should. Besides, some
# lines that begin with "(raylet)" appear on standard OUTPUT a moment later, from a thread of the driver. A program whose
# output is JSON or CSV is broken by it. Redirecting sys.stdout while tasks run keeps them away.
# The script fails if any of this changes.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check "ray==2.60.0"
cat > "$work/see.py" <<'PY'
import os
import signal
import sys
import time

import ray

os.environ.setdefault("RAY_AUTH_TOKEN", "none-of-importance-0123456789abcdef")
ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False, logging_level="CRITICAL")


@ray.remote(max_retries=0)
def lost():
    os.kill(os.getpid(), signal.SIGKILL)


try:
    ray.get(lost.remote())
except ray.exceptions.WorkerCrashedError:
    print("WorkerCrashedError", file=sys.stderr)
time.sleep(5)
ray.shutdown()
PY
export RAY_AUTH_TOKEN=none-of-importance-0123456789abcdef RAY_USAGE_STATS_ENABLED=0 HOME="$work"
"$work/venv/bin/python" "$work/see.py" > "$work/out" 2> "$work/err"
echo "ray $("$work/venv/bin/python" -c 'import ray; print(ray.__version__)')"
echo "standard error: $(grep -c WorkerCrashedError "$work/err") line of our own"
echo "standard output, of a program that prints nothing there:"
cut -c1-120 "$work/out" | head -3
grep -q "WorkerCrashedError" "$work/err"
grep -q "(raylet)" "$work/out"
echo "as described"
