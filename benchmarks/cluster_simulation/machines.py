"""The nodes of a simulated cluster: their speed, when they are lost, and the storage that they share."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass

INFINITE = float("inf")


@dataclass(frozen=True)
class Storage:
    """A folder that all nodes share."""

    total_bytes_per_s: float = INFINITE
    node_bytes_per_s: float = INFINITE  # of one task's connection

    def seconds(self, compute_s: float, read_bytes: float, tasks: int) -> float:
        """Of a task, when so many are at work: reading and computing by turns, or its share of a full storage."""
        alone_s = compute_s + read_bytes / self.node_bytes_per_s
        return max(alone_s, read_bytes * tasks / self.total_bytes_per_s)


@dataclass(frozen=True)
class Machines:
    """Nodes of a cluster. A node that is lost is replaced by a fresh one."""

    nodes: int
    cpus: float = 2.0
    mtbf_s: float = INFINITE  # of a node, failures and spot preemption together
    replaced_after_s: float = 300.0
    noticed_after_s: float = 30.0  # Ray's health check
    outage_at_s: float = INFINITE  # when `outage_share` of the nodes are lost at once
    outage_share: float = 0.0
    slow_share: float = 0.0
    slow_factor: float = 3.0
    start_s: float = 0.0  # of a worker process, before the first task of each CPU
    storage: Storage = Storage()
    seed: int = 0

    def slowness(self, node: int) -> float:
        """Factor on the time of the node's tasks."""
        slow = random.Random(f"{self.seed}/slow/{node}").random() < self.slow_share
        return self.slow_factor if slow else 1.0

    def losses_s(self, node: int) -> Iterator[float]:
        """The times when the machine in a node's place is lost, increasing, without end."""
        chance, outage = random.Random(f"{self.seed}/lost/{node}"), self._outage_s(node)
        at_s = 0.0
        while True:
            at_s += chance.expovariate(1.0 / self.mtbf_s) if self.mtbf_s < INFINITE else INFINITE
            if outage < at_s:
                yield outage
                outage = INFINITE
            yield at_s

    def _outage_s(self, node: int) -> float:
        struck = random.Random(f"{self.seed}/outage/{node}").random() < self.outage_share
        return self.outage_at_s if struck else INFINITE
