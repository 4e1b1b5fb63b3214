"""Laws of the simulated cluster, on which the fleet's own scheduler and engine for Ray run."""

from collections import Counter
from dataclasses import replace
from itertools import pairwise

import pytest

from benchmarks.cluster_simulation import Day, DriverCosts, Drives, Machines, Storage, Task, simulate

STEPS = {"detect": Task(60.0, resumes=True), "track": Task(20.0), "map": Task(40.0)}


def drives(count, steps=STEPS, **more):
    return Drives({f"d{k:03d}": steps for k in range(count)}, **more)


def only(seconds, count=1, **more):
    """Drives of one step."""
    return drives(count, {"detect": Task(seconds, **more)})


@pytest.mark.parametrize(("nodes", "cpus"), [(1, 1.0), (3, 2.0), (6, 4.0)])
def test_equal_tasks_that_do_not_fail_take_exactly_their_time(nodes, cpus):
    report = simulate(Day(drives(24), Machines(nodes, cpus)))
    assert report.makespan_s == pytest.approx(24 / (nodes * cpus) * 120.0)
    assert report.utilization == pytest.approx(1.0)
    assert (report.wasted, report.losses, report.failed) == (0.0, 0, 0)


def test_unequal_tasks_follow_the_scheduler():
    usual, other = {"detect": Task(3.0), "map": Task(4.0)}, {"detect": Task(1.0), "map": Task(5.0)}
    report = simulate(Day(Drives({"a": usual, "b": other, "c": usual}), Machines(1, 2.0)))
    assert report.makespan_s == pytest.approx(13.0)  # c waits until b, which has begun, has ended at 6 s


def test_tasks_of_a_lost_node_run_again_and_none_counts_twice():
    machines = Machines(4, 2.0, mtbf_s=300.0, replaced_after_s=100.0, noticed_after_s=10.0)
    report = simulate(Day(drives(40), machines, retries=1000))
    assert report.losses > 5
    assert report.failed == 0
    assert len(report.ended) == 3 * 40
    assert set(report.ended.values()) == {1}
    for result in report.results:
        ended = Counter(task.step for task in result.tasks if task.how == "done")
        assert ended == Counter(list(STEPS)), result.name
    lost = sum(task.how.startswith("lost") for result in report.results for task in result.tasks)
    assert lost == report.losses
    assert 0.0 < report.wasted < 1.0


def test_a_lost_step_waits_for_notice_and_a_node_and_detection_resumes():
    outage = Machines(1, 1.0, outage_at_s=50.0, outage_share=1.0, replaced_after_s=50.0, noticed_after_s=30.0)
    assert simulate(Day(only(100.0), outage)).makespan_s == pytest.approx(200.0)
    assert simulate(Day(only(100.0, resumes=True), outage)).makespan_s == pytest.approx(150.0)
    late = replace(outage, noticed_after_s=500.0)
    assert simulate(Day(only(100.0), late)).makespan_s == pytest.approx(650.0)


def test_a_drive_that_lost_too_many_workers_fails():
    outage = Machines(1, 1.0, outage_at_s=50.0, outage_share=1.0, replaced_after_s=50.0)
    report = simulate(Day(only(100.0, count=3), outage, retries=0))
    assert report.failed == 1
    assert [result.how for result in report.results] == ["failed", "done", "done"]


def test_a_cluster_without_nodes_for_a_minute_fails_the_drive_under_way():
    outage = Machines(1, 1.0, outage_at_s=50.0, outage_share=1.0, replaced_after_s=150.0)
    report = simulate(Day(only(100.0, count=2), outage))
    assert [result.how for result in report.results] == ["failed", "done"]
    assert "no node of the cluster" in report.results[0].reason


def test_the_same_seed_gives_the_same_and_another_does_not():
    def makespan(seed):
        machines = Machines(5, 2.0, mtbf_s=900.0, slow_share=0.3, seed=seed)
        of_drives = drives(30, ratios=(0.8, 1.0, 1.3), straggler_sigma=0.3, seed=seed)
        return simulate(Day(of_drives, machines, DriverCosts(submit_s=0.01), retries=99)).makespan_s

    assert makespan(1) == makespan(1)
    assert makespan(1) != makespan(2)


def test_more_nodes_are_never_much_slower():
    found = [
        simulate(Day(drives(60, straggler_sigma=0.2), Machines(nodes, 1.0, mtbf_s=20000.0), retries=99)).makespan_s
        for nodes in (1, 3, 9, 27)
    ]
    assert all(more <= 1.05 * fewer for fewer, more in pairwise(found))
    assert found[-1] < found[0] / 12


def test_slow_nodes_and_first_tasks_take_longer():
    assert simulate(Day(drives(2), Machines(2, 1.0, slow_share=1.0, slow_factor=3.0))).makespan_s == pytest.approx(360)
    assert simulate(Day(drives(4), Machines(2, 1.0, start_s=5.0))).makespan_s == pytest.approx(245)


def test_the_driver_s_time_holds_up_a_large_cluster():
    costs = DriverCosts(submit_s=1.0)
    report = simulate(Day(only(10.0, count=100), Machines(100, 1.0), costs))
    assert report.makespan_s == pytest.approx(110.0)
    assert report.driver_busy == pytest.approx(100 / 110)
    assert simulate(Day(only(10.0, count=100), Machines(100, 1.0))).makespan_s == pytest.approx(10.0)
    waits = simulate(Day(only(10.0, count=100), Machines(100, 1.0), DriverCosts(wait_reference_s=0.01)))
    assert waits.makespan_s > 10.5


def test_a_full_storage_gives_each_task_its_share():
    reading = only(10.0, count=40, read_bytes=1e9)
    wide = simulate(Day(reading, Machines(40, 1.0, storage=Storage(node_bytes_per_s=0.1e9))))
    assert wide.makespan_s == pytest.approx(20.0)
    full = simulate(Day(reading, Machines(40, 1.0, storage=Storage(1e9, 0.1e9))))
    assert full.makespan_s == pytest.approx(40.0)


def test_the_tasks_at_work_are_told_over_time():
    report = simulate(Day(only(10.0, count=3), Machines(1, 2.0)))
    assert report.mean_at_work(4) == pytest.approx([2.0, 2.0, 1.0, 1.0])
    assert simulate(Day(only(10.0, count=200), Machines(1, 1.0))).most_done_s == pytest.approx(1980.0, abs=15.0)
