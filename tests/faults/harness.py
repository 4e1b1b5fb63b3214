"""Commands under faults: the process is killed or interrupted, or the disk fills, at one step; then it is judged."""

import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from meshslam.files import digest_of_file
from meshslam.maps.manifest import Manifest

ROOT = Path(__file__).resolve().parents[2]
VOLATILE = {"metrics.json", "report.html", "recording.rrd", "manifest.json"}  # they hold times, or follow from the rest


class Zygote:
    """Runs commands in forks of one process that has imported everything."""

    def __init__(self, scratch):
        self.log = scratch / "log"
        paths = os.pathsep.join([str(ROOT), str(ROOT / "python"), *filter(None, sys.path)])
        environment = {**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1"}
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        command = [sys.executable, "-m", "tests.faults.zygote"]
        self.process = subprocess.Popen(command, cwd=ROOT, env=environment, **pipes)
        assert self.process.stdout.readline() == "ready\n"

    def run(self, arguments, at=0, how="count", memory=None, uid=None, first=(), **environment):
        """Exit code (negative: the signal that killed it) and the number of steps; what it said is in `said`.

        `memory` is a folder that keeps estimates: files are what is under test. `uid` is another user's, who runs
        nothing but files that the command `first` has loaded.
        """
        request = {"arguments": [str(a) for a in arguments], "at": at, "how": how, "log": str(self.log)}
        request |= {"environment": environment, "memory": memory and str(memory), "uid": uid}
        request["first"] = [str(a) for a in first]
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        answer = json.loads(self.process.stdout.readline())
        return answer["code"], answer["steps"]

    @property
    def said(self):
        """What the last command printed."""
        return self.log.read_text()

    def close(self):
        """End the process."""
        self.process.stdin.close()
        self.process.wait(timeout=60)
        self.process.stdout.close()


@dataclass
class Case:
    """A command that writes `target`; `old` is what is there before, if anything."""

    name: str
    arguments: list
    target: Path
    old: Path | None = None
    new: Path | None = None  # the undisturbed result
    environment: dict = field(default_factory=dict)
    found: Counter = field(default_factory=Counter)  # states after a fault

    def prepare(self):
        """Put the target back to what was there before."""
        for path in (self.target, *self.target.parent.glob(f".{self.target.name}*")):
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        if self.old is not None:
            copy = shutil.copytree if self.old.is_dir() else shutil.copy2
            copy(self.old, self.target)


def contents(path):
    """What a result says, by file: digests."""
    files = [p for p in path.rglob("*") if p.is_file()] if path.is_dir() else [path]
    return {
        str(p.relative_to(path)): digest_of_file(p) for p in files if p.name not in VOLATILE and ".mesh" not in str(p)
    }


def state_of(case):
    """Old, new, incomplete or nothing; an AssertionError for a mixture that passes as whole."""
    target = case.target
    if not target.exists():
        return "nothing"
    is_run = (target / "config.yaml").is_file()
    if is_run and not Manifest.load(target).is_whole(target):
        return "incomplete"
    if not is_run and target.is_dir() and not (target / "simulation.yaml").is_file() and target.suffix != ".store":
        return "incomplete"
    now = contents(target)
    if case.old is not None and now == contents(case.old):
        return "old"
    if target.suffix == ".store" and not any(name.endswith(".onnx") for name in now):
        return "nothing"
    assert now == contents(case.new), f"{case.name}: a mixture of {sorted(now)} passes as whole"
    return "new"


def leftovers(case):
    """Files with names that only live while something is written."""
    around = [*case.target.parent.glob(f".{case.target.name}*")]
    inside = [*case.target.rglob(".*")] if case.target.is_dir() else []
    return [str(p) for p in around + inside if not p.name.endswith("-files.json")]


def disturb(zygote, case, at, how, memory=None):
    """The command with a fault, the state it leaves, and the same command again, which must end as undisturbed."""
    case.prepare()
    code, _ = zygote.run(case.arguments, at, how, memory, **case.environment)
    said = zygote.said
    where = f"{case.name}: {how} at step {at}: exit code {code}: {said[-800:]}"
    expected = {"kill": (-9, 0), "interrupt": (130, 0), "full": (2, 0)}[how]
    assert code in expected, where
    assert "Traceback" not in said, where
    if how == "full" and code == 2:
        assert "No space left" in said, where
    if how != "kill":
        assert not leftovers(case), (where, leftovers(case))
    state = state_of(case)
    assert case.old is None or how == "kill" or state != "nothing", where
    assert code != 0 or state == "new", where
    again, _ = zygote.run(case.arguments, memory=memory, **case.environment)
    already = again == 2 and "there already" in zygote.said and state == "new"
    assert again == 0 or already, (where, zygote.said[-800:])
    assert state_of(case) == "new", where
    assert not leftovers(case), (where, leftovers(case))
    case.found[f"{how}: {state}"] += 1
    return state


def undisturbed(zygote, case, memory=None):
    """The result of the command in peace, kept beside the target; the number of its steps."""
    case.prepare()
    code, steps = zygote.run(case.arguments, memory=memory, **case.environment)
    assert code == 0, zygote.said
    kept = case.target.parent / f"{case.name.replace(' ', '_')}_undisturbed{case.target.suffix}"
    case.new = Path(shutil.move(case.target, kept))
    return steps
