#!/usr/bin/env bash
# ONNX Runtime 1.32.0 for Python keeps a device id and a database of events in the user's cache as soon as it is imported
# on Linux; 1.28.0 keeps nothing.
#
# No session is made and no network is run: `import onnxruntime` alone makes
# ~/.cache/Microsoft/DeveloperTools/.onnxruntime with the files `deviceid` and `onnxruntime.db` (SQLite), and starts a
# thread. `onnxruntime.disable_telemetry_events()` can only be called after that, and the files stay.
# ORT_DISABLE_TELEMETRY=1, set before the import, leaves both out. A program that embeds the runtime has to set it in its
# own process, before whatever imports it first.
# The script fails if any of this changes.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat > "$work/see.py" <<'PY'
import os
import sys

import onnxruntime

if "call" in sys.argv:
    onnxruntime.disable_telemetry_events()
print(onnxruntime.__version__, "one thread" if len(os.listdir("/proc/self/task")) == 1 else "threads")
PY
unset CI XDG_CACHE_HOME ORT_DISABLE_TELEMETRY
see() { # VERSION NAME ARGUMENTS: what is in a fresh home after an import
  local version=$1 home="$work/$2"
  mkdir -p "$home"
  HOME="$home" OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 "$work/$version/bin/python" "$work/see.py" "${@:3}"
  (cd "$home" && find . -type f | sed 's/-wal$//; s/-shm$//' | sort -u)
}
for version in 1.28.0 1.32.0; do
  python3 -m venv "$work/$version"
  "$work/$version/bin/pip" install --quiet --disable-pip-version-check "onnxruntime==$version"
done
cache=./.cache/Microsoft/DeveloperTools/.onnxruntime
kept="$cache/deviceid
$cache/onnxruntime.db"
[ "$(see 1.28.0 old)" = "1.28.0 one thread" ]
[ "$(see 1.32.0 new)" = "1.32.0 threads
$kept" ]
[ "$(see 1.32.0 called call | tail -n 2)" = "$kept" ]
[ "$(ORT_DISABLE_TELEMETRY=1 see 1.32.0 off)" = "1.32.0 one thread" ]
echo "as described: 1.28.0 keeps nothing; 1.32.0 keeps $kept unless ORT_DISABLE_TELEMETRY=1"
