"""A process that has imported everything and forks itself for each command: what a command costs is its work alone.

Lines in: {"arguments", "at", "how", "environment", "log", "uid", "first"}. Lines out: {"code", "steps"}.
"""

import contextlib
import ctypes
import importlib
import json
import mmap
import os
import pickle
import sys
import traceback
from pathlib import Path

from meshslam.files import digest_of
from tests.faults.hook import Hook

ROOMS = (
    "categories",
    "cli",
    "evaluation",
    "experiments",
    "localization",
    "object_slam",
    "runs",
    "simulation",
    "viewing",
)


def work(request, count):
    """The command, in a process of its own; the exit code is the process's."""
    log = os.open(request["log"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(log, 1)
    os.dup2(log, 2)
    os.environ.update(request["environment"])
    if request["memory"]:
        remember(Path(request["memory"]))
    if request["uid"]:
        load_all(request["first"])
        os.setgroups([])
        os.setresgid(*[request["uid"]] * 3)
        os.setresuid(*[request["uid"]] * 3)
    sys.argv = ["meshslam", *request["arguments"]]
    Hook(request["at"], request["how"], count).install()
    from meshslam.cli import main

    code = 0
    try:
        main()
    except SystemExit as end:
        code = end.code or 0
    except BaseException:
        traceback.print_exc()
        code = 99
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def load_all(arguments):
    """Run a command, so that nothing is left to import: another user may not read the interpreter's files."""
    from meshslam.cli import main

    sys.argv = ["meshslam", *arguments]
    with contextlib.suppress(SystemExit):
        main()
    sys.stdout.flush()
    for handle in (1, 2):
        os.ftruncate(handle, 0)
        os.lseek(handle, 0, os.SEEK_SET)
    importlib.import_module("unicodedata")


def remember(folder):
    """Estimates come from memory where they were made before, reports are empty: files are under test, not these."""
    from meshslam import categories
    from meshslam.runs import localize_run, map_run, report, slam_run

    report.write_report = lambda _, last: "<html></html>" if last() else ""
    for module, name, at in (
        (map_run, "map_recording", 1),
        (localize_run, "localize_recording", 2),
        (slam_run, "slam_recording", 1),
        (categories, "category_from_meshes", 3),
    ):
        setattr(module, name, remembered(getattr(module, name), folder, name, at))


def remembered(make, folder, name, settings_at):
    """The same function; its results lie in `folder`, by its settings."""

    def made(*arguments, **options):
        path = folder / f"{name}-{digest_of(arguments[settings_at])}"
        if not path.exists():
            path.write_bytes(pickle.dumps(make(*arguments, **options)))
        return pickle.loads(path.read_bytes())

    return made


def serve():
    """Answer requests until the input ends."""
    for room in ROOMS:
        importlib.import_module(f"meshslam.{room}")
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # as the commands do: it has threads, and a fork would wait for them
    import onnxruntime  # noqa: F401
    import rich.table  # noqa: F401

    shared = mmap.mmap(-1, 8)
    count = ctypes.c_longlong.from_buffer(shared)
    print("ready", flush=True)
    for line in sys.stdin:
        count.value = 0
        child = os.fork()
        if child == 0:
            work(json.loads(line), count)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        print(json.dumps({"code": code, "steps": count.value}), flush=True)


if __name__ == "__main__":
    serve()
