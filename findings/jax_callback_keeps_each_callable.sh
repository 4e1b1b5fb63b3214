#!/usr/bin/env bash
# jax 0.10.2: a pure_callback outside `jit` compiles for every new callable, and the process keeps what was compiled.
#
# jax.pure_callback(f, shape, x) that is called without `jit` keeps what it compiles by f. The same f costs some 0.05 ms
# and no memory. functools.partial(f) made anew for each call, or a lambda, is another callable each time, although it
# does the same: each call takes some 10 ms and leaves 1.4 MB in the process. It is linear over a thousand calls, and
# jax.clear_caches() with gc.collect() gives nothing back. Code that passes settings by a partial, as under `jit`, where
# it costs nothing, grows by a gigabyte in 700 calls. A callable of a frozen dataclass, whose equal instances are equal
# and have one hash, costs what the same function does.
# The script fails if any of this changes.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check "jax==0.10.2" "jaxlib==0.10.2" "numpy>=2"
cat > "$work/see.py" <<'PY'
import gc
import os
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

os.environ["JAX_PLATFORMS"] = "cpu"
import jax
import jax.numpy as jnp
import numpy as np

CALLS = 200
SHAPE, X = jax.ShapeDtypeStruct((8,), np.float32), jnp.ones(8)


def scaled(factor, x):
    return factor * np.asarray(x)


def double(x):
    return scaled(np.float32(2), x)


@dataclass(frozen=True)
class Scaled:
    factor: float

    def __call__(self, x):
        return scaled(np.float32(self.factor), x)


def resident_kb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1024


def cost(call):
    """Milliseconds and kB a call."""
    call()
    before, begun = resident_kb(), time.perf_counter()
    for _ in range(CALLS):
        call()
    return (time.perf_counter() - begun) / CALLS * 1e3, (resident_kb() - before) / CALLS


def of(make):
    return lambda: jax.pure_callback(make(), SHAPE, X).block_until_ready()


compiled = jax.jit(lambda x: jax.pure_callback(partial(scaled, np.float32(2)), SHAPE, x))
first = resident_kb()
rows = {
    "one function": cost(of(lambda: double)),
    "an equal dataclass each time": cost(of(lambda: Scaled(2.0))),
    "a partial, under jit": cost(lambda: compiled(X).block_until_ready()),
    "a partial each time": cost(of(lambda: partial(scaled, np.float32(2)))),
}
grown = resident_kb() - first
jax.clear_caches()
gc.collect()
kept = (resident_kb() - first) / grown
print("jax", jax.__version__)
for name, (ms, kb) in rows.items():
    print(f"{name}: {ms:.2f} ms and {kb:.0f} kB a call")
print(f"share of the memory that is still there after clear_caches and gc: {kept:.2f}")
small = [rows[name] for name in rows if name != "a partial each time"]
ms, kb = rows["a partial each time"]
assert max(row[1] for row in small) < 50, "something else grows, too"
assert kb > 500, "a partial leaves no memory behind any more"
assert ms > 10 * max(row[0] for row in small), "a partial is no longer compiled in each call"
assert kept > 0.8, "clear_caches gives memory back now"
print("as described")
PY
"$work/venv/bin/python" "$work/see.py"
