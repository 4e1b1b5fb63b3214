"""A Ray cluster of two nodes on this machine: workers and a whole node are killed, and every good drive is there."""

import contextlib
import json
import os
import secrets
import signal
import tempfile
from pathlib import Path

import pytest
import yaml

from meshslam.files import LOCK
from meshslam.fleet import engine_of, place_of, read_fleet
from meshslam.fleet import run_fleet as run_fleet_of
from tests.fleet.conftest import (
    BAD_IMAGE,
    NAMES,
    POISONED,
    assert_equal_to_singles,
    begin_fleet,
    end,
    run_fleet,
    seen,
    states_of,
)
from tests.fleet.killing import (
    environment_of,
    halted_in_the_middle,
    kill,
    killed_in_the_middle,
    raylet_of,
    raylets,
    writers,
)

ray = pytest.importorskip("ray")


@pytest.fixture(scope="module")
def cluster():
    """A head of one CPU, and a node of one."""
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as temporary:
        patch.setenv("TMPDIR", temporary)  # of its workers: other tests have theirs
        patch.setenv("RAY_AUTH_TOKEN", secrets.token_hex(32))  # or Ray leaves one in the home folder
        made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
        yield made
        made.shutdown()


def tell(out):
    return json.loads((out / "fleet.json").read_text())


def test_a_worker_and_a_node_are_killed_and_nothing_is_missing_or_done_twice(cluster, fleet_file, singles, tmp_path):
    node, out, log = cluster.add_node(num_cpus=1), tmp_path / "out", tmp_path / "log"
    process = begin_fleet(log, fleet_file, "--out", out, "--engine", "ray", "--address", cluster.address)
    given = environment_of(seen(lambda: list(writers(out).values()))[0])
    assert {"OMP_NUM_THREADS=1", "OPENBLAS_NUM_THREADS=1", "RAYON_NUM_THREADS=1"} <= set(given)
    of_node = raylet_of(node)
    of_head = raylet_of(cluster.head_node)
    # the head's worker is held until the node has a drive, too, however slowly its worker starts
    first, pid = seen(lambda: halted_in_the_middle(out, NAMES, of_head))
    second = seen(lambda: killed_in_the_middle(out, NAMES, of_node))
    kill(pid)
    assert process.wait(timeout=240) == 1
    cluster.remove_node(node, allow_graceful=False)
    assert "its node was lost" in log.read_text()
    assert "(raylet)" not in log.read_text()  # what Ray prints of its own
    assert_equal_to_singles(out, singles)
    assert states_of(tell(out)) == dict.fromkeys(NAMES, "done") | {POISONED: "failed", BAD_IMAGE: "failed"}
    attempts = {drive["name"]: drive["attempts"] for drive in tell(out)["drives"]}
    assert sum(attempts.values()) == 6 + 2, attempts
    assert attempts[POISONED] == attempts[BAD_IMAGE] == 1
    assert attempts[first] + attempts[second] == (6 if first == second else 4)
    for drive in tell(out)["drives"]:
        ended = [task["step"] for task in drive["tasks"] if not task["how"].startswith("lost")]
        assert len(ended) == len(set(ended)), drive

    again = run_fleet(fleet_file, "--out", out, "--engine", "ray", "--address", cluster.address)
    assert again.returncode == 1
    assert states_of(tell(out)) == dict.fromkeys(NAMES, "unchanged") | {POISONED: "failed", BAD_IMAGE: "failed"}


def test_without_a_shared_folder_files_travel_through_the_object_store(cluster, few_file, singles, tmp_path):
    out, given = tmp_path / "out", ("--engine", "ray", "--address", cluster.address, "--no-shared-folder")
    process = begin_fleet(tmp_path / "log", few_file, "--out", out, *given)
    seen(lambda: killed_without_folder(Path(os.environ["TMPDIR"])))
    assert process.wait(timeout=240) == 0
    assert_equal_to_singles(out, singles, NAMES[:2])
    assert "its worker was lost" in (tmp_path / "log").read_text()


def killed_without_folder(temporary):
    """A worker that has a run directory in its temporary folder, which is at work therefore."""
    for lock in temporary.glob(f"meshslam-fleet-*/*/{LOCK}"):
        with contextlib.suppress(OSError, ValueError, KeyError):
            pid = json.loads(lock.read_text())["pid"]
            os.kill(pid, signal.SIGSTOP)
            if lock.exists():
                os.kill(pid, signal.SIGKILL)
                return True
            os.kill(pid, signal.SIGCONT)
    return False


def test_a_step_that_no_node_can_take_fails_its_drive_with_the_reason(cluster, fleet_file, tmp_path, monkeypatch):
    from meshslam.fleet import cluster as engine_module

    content = yaml.safe_load(fleet_file.read_text())
    content["resources"] = {"map": {"segmenter": 1}}
    file = fleet_file.with_name("needs.yaml")
    file.write_text(yaml.safe_dump({**content, "drives": content["drives"][:2]}))
    monkeypatch.setattr(engine_module, "PATIENCE_S", 3.0)
    place = place_of(str(tmp_path / "out"), shared=True)
    results = run_fleet_of(read_fleet(file), place, lambda: engine_of("ray", cluster.address, None))
    by_name = {result.name: result for result in results}
    assert "no node of the cluster has had what it needs for 3 s: CPU 1, segmenter 1" in by_name[NAMES[0]].reason
    assert "camera.yaml" in by_name[POISONED].reason


def test_ray_that_is_started_here_ends_with_ctrl_c_and_leaves_nothing(fleet_file, tmp_path):
    out, log = tmp_path / "out", tmp_path / "log"
    home = tmp_path / "home"
    home.mkdir()
    before = raylets()
    process = begin_fleet(
        log, fleet_file, "--out", out, "--engine", "ray", "--workers", "2", HOME=str(home), RAY_AUTH_TOKEN=""
    )
    held = seen(lambda: writers(out))
    assert end(process) == 130
    assert "goes on from there" in log.read_text()
    assert "Traceback" not in log.read_text()
    assert raylets() <= before
    assert not writers(out), held
    assert "not run" in states_of(tell(out)).values()
    assert list(home.iterdir()) == []  # no token of Ray's
