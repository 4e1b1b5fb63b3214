"""The node, its drivers and a listener as processes of their own, on a domain of their own, over DDS on loopback."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def environment(domain, scratch):
    kept = {k: v for k, v in os.environ.items() if k not in ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")}
    return kept | {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(scratch / "ros_log"),
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "python")]),
        "OMP_NUM_THREADS": "1",
        "PYTHONUNBUFFERED": "1",
    }


class World:
    """One ROS domain with its processes; they are ended by their ids."""

    def __init__(self, scratch, domain=None):
        self.scratch, self.domain = scratch, domain or 1 + (os.getpid() * 7 + int(time.time())) % 100
        self.environment = environment(self.domain, scratch)
        self.processes = []

    def start(self, name, *arguments, stdin=None):
        """A module of Python as a process; what it says goes to NAME.log."""
        log = (self.scratch / f"{name}.log").open("a")
        command = [sys.executable, "-m", *map(str, arguments)]
        process = subprocess.Popen(
            command, cwd=ROOT, env=self.environment, stdout=log, stderr=subprocess.STDOUT, stdin=stdin
        )
        log.close()
        process.name = name
        self.processes.append(process)
        return process

    def node(self, *arguments, name="node"):
        return self.start(name, "meshslam", "ros2", *arguments)

    def publisher(self, *arguments, name="publisher"):
        return self.start(name, "tests.ros2.publisher", *arguments)

    def listener(self, *arguments, name="listener"):
        process = self.start(
            name, "tests.ros2.listener", self.scratch / f"{name}.json", *arguments, stdin=subprocess.PIPE
        )
        self.wait_for(name, "listening")
        return process

    def heard(self, listener):
        """What a listener heard, until now; it ends."""
        listener.stdin.close()
        listener.wait(timeout=20)
        return json.loads((self.scratch / f"{listener.name}.json").read_text())

    def said(self, name="node"):
        return (self.scratch / f"{name}.log").read_text()

    def wait_for(self, name, text, timeout_s=40.0):
        """Until a process has said something."""
        end_s = time.monotonic() + timeout_s
        while text not in self.said(name):
            running = [p for p in self.processes if p.name == name]
            assert running[-1].poll() is None or text in self.said(name), f"{name} ended: {self.said(name)[-3000:]}"
            assert time.monotonic() < end_s, f"{name} did not say {text!r}: {self.said(name)[-3000:]}"
            time.sleep(0.05)

    def end(self, process, with_signal=signal.SIGTERM, timeout_s=60):
        """The exit code after a signal."""
        process.send_signal(with_signal)
        return process.wait(timeout=timeout_s)

    def close(self):
        for process in self.processes:
            if process.poll() is None:
                process.kill()
            process.wait()
            if process.stdin is not None and not process.stdin.closed:
                process.stdin.close()
