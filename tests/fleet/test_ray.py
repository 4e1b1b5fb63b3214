"""A Ray cluster of two nodes on this machine: workers and a whole node are killed, and every good drive is there."""

import json
import os
import secrets

import pytest

from tests.fleet.conftest import (
    BAD_IMAGE,
    NAMES,
    POISONED,
    assert_equal_to_singles,
    begin_fleet,
    run_fleet,
    seen,
    states_of,
)
from tests.fleet.killing import killed_in_the_middle, raylet_of

ray = pytest.importorskip("ray")


@pytest.fixture(scope="module")
def cluster():
    """A head of one CPU, and a node of one."""
    from ray.cluster_utils import Cluster

    if "RAY_AUTH_TOKEN" not in os.environ:
        os.environ["RAY_AUTH_TOKEN"] = secrets.token_hex(32)  # or Ray leaves one in the home folder
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    yield made
    made.shutdown()
    del os.environ["RAY_AUTH_TOKEN"]


def tell(out):
    return json.loads((out / "fleet.json").read_text())


def test_a_worker_and_a_node_are_killed_and_nothing_is_missing_or_done_twice(cluster, fleet_file, singles, tmp_path):
    node, out, log = cluster.add_node(num_cpus=1), tmp_path / "out", tmp_path / "log"
    process = begin_fleet(log, fleet_file, "--out", out, "--engine", "ray", "--address", cluster.address)
    first = seen(lambda: killed_in_the_middle(out, NAMES))
    second = seen(lambda: killed_in_the_middle(out, NAMES, raylet_of(node)))
    assert process.wait(timeout=240) == 1
    cluster.remove_node(node, allow_graceful=False)
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
