import subprocess
import sys
import time

import pytest

from meshslam.runs import Clock
from meshslam.runs.clock import peak_memory_mb, process_age_s


def test_the_total_is_what_passed_and_stages_are_parts_of_it():
    clock = Clock()
    with clock.timing("perception"):
        time.sleep(0.02)
    time.sleep(0.02)
    with clock.timing("report"):
        time.sleep(0.01)
    clock.move("perception", "mapping", 0.005)
    found = clock.figures(frames=5)
    assert found["seconds_total"] >= 0.05
    assert found["seconds_perception"] + found["seconds_mapping"] + found["seconds_report"] < found["seconds_total"]
    assert found["milliseconds_per_frame"] == pytest.approx(
        1e3 * (found["seconds_perception"] + found["seconds_mapping"]) / 5, abs=1e-3
    )
    assert "seconds_imports" not in found


def test_a_clock_of_the_process_has_run_since_its_start():
    code = (
        "import time; time.sleep(0.3); from meshslam.runs import Clock; f = Clock.of_process().figures(1); "
        "print(f['seconds_imports'], f['seconds_total'])"
    )
    began_s = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    waited_s = time.perf_counter() - began_s
    imports_s, total_s = map(float, done.stdout.split())
    assert 0.3 <= imports_s <= total_s <= waited_s + 0.02
    assert 0.3 < process_age_s() < 1e6


def test_memory_only_grows():
    before_mb = peak_memory_mb()
    block = bytearray(b"x" * 80_000_000)
    assert peak_memory_mb() - before_mb > 20 or before_mb > 500
    assert len(block)
