#!/usr/bin/env bash
# Ray 2.60.0: what a handler of SIGINT raises in ray.get or ray.wait comes as a SystemError, after the whole timeout,
# unless it is a KeyboardInterrupt.
#
# Many command lines have a handler of their own that raises an exception of theirs, as click and typer take a
# KeyboardInterrupt for themselves. Python raises such an exception at once from any call that waits. Ray waits in native
# code that looks for signals, and knows KeyboardInterrupt and SystemExit alone: with another exception it goes on
# waiting until its timeout ends (for ever without one), then raises "SystemError: ... returned a result with an
# exception set". SystemError is an Exception: `except Exception` around ray.get then swallows Ctrl-C.
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
import threading
import time

import ray


class Stop(BaseException):
    pass


KINDS = {"Stop": Stop, "KeyboardInterrupt": KeyboardInterrupt}


def handler(number, frame):
    raise KINDS[sys.argv[2]]


ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False, logging_level="CRITICAL")
signal.signal(signal.SIGINT, handler)


@ray.remote
def slow():
    time.sleep(15)


task = slow.remote()
threading.Timer(2.0, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
begun_s = time.monotonic()
try:
    if sys.argv[1] == "get":
        ray.get(task, timeout=8)
    else:
        ray.wait([task], timeout=8)
except BaseException as error:
    print(f"ray.{sys.argv[1]}, {sys.argv[2]}: {type(error).__name__} after {time.monotonic() - begun_s:.0f} s", flush=True)
os._exit(0)
PY
export RAY_AUTH_TOKEN=none-of-importance-0123456789abcdef RAY_USAGE_STATS_ENABLED=0 HOME="$work"
echo "ray $("$work/venv/bin/python" -c 'import ray; print(ray.__version__)'); the signal comes after 2 s, the timeout is 8 s"
for call in get wait; do
  for kind in Stop KeyboardInterrupt; do
    "$work/venv/bin/python" "$work/see.py" "$call" "$kind" 2> /dev/null | tee -a "$work/out"
  done
done
for call in get wait; do
  grep -q "^ray.$call, Stop: SystemError after 8 s" "$work/out"
  grep -q "^ray.$call, KeyboardInterrupt: KeyboardInterrupt after 2 s" "$work/out"
done
echo "as described"
