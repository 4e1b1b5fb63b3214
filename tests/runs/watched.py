"""Runs everything that estimates, in a process that watches every file it opens; prints what truth it opened, and when.

Arguments: the recording, a map's folder, a folder for runs, stages; then perhaps MODULE:FUNCTION:FILE, a reader that is
to read a truth file and to ignore it. Each line of the output is a stage, a truth file that it opened, and whether the
stage's estimate was on the disk then.
"""

import importlib
import json
import os
import sys
from pathlib import Path

from meshslam.runs import Config, InputConfig, Outlet, localize, map_drive, run_localize, run_map, run_slam, slam
from meshslam.sequences import check_sequence, open_sequence

TRUTH = ("groundtruth.tum", "objects.json", "association.json")


class Watch:
    """Notes truth files that the interpreter opens."""

    def __init__(self, recording):
        self.recording, self.estimates, self.opened = os.path.realpath(recording), None, []
        sys.addaudithook(self)

    def __call__(self, event, arguments):
        if event != "open" or not isinstance(arguments[0], str | bytes | os.PathLike):
            return
        folder, name = os.path.split(os.path.realpath(os.fsdecode(arguments[0])))
        if name in TRUTH and folder == self.recording:
            self.opened.append((name, self.is_on_disk()))

    def is_on_disk(self):
        return self.estimates is not None and all(os.path.exists(path) for path in self.estimates)  # noqa: PTH110 # fast


def spoil(recording, where):
    """Let a function read a truth file, and ignore it, before it does its work."""
    module, function, file = where.split(":")
    room = importlib.import_module(module)
    plain = getattr(room, function)

    def reads_and_ignores(*arguments, **named):
        (recording / file).read_bytes()
        return plain(*arguments, **named)

    setattr(room, function, reads_and_ignores)


def main(recording, scene, out, stages, *spoiled):
    recording, scene, out = Path(recording), Path(scene), Path(out)
    for where in spoiled:
        spoil(recording, where)
    watch, told = Watch(recording), Config(input=InputConfig(sequence=str(recording), map=str(scene)))
    work = {
        "open": (lambda: open_sequence(recording).read_image(0), None),
        "check": (lambda: check_sequence(recording), None),
        "map_drive": (lambda: map_drive(recording), None),
        "localize": (lambda: localize(recording, scene), None),
        "slam": (lambda: slam(recording), None),
        "run_map": (
            lambda: run_map(told, out / "map", Outlet(), overwrite=False),
            ("map/map.json", "map/trajectory.tum"),
        ),
        "run_localize": (
            lambda: run_localize(told, out / "localize", Outlet(), overwrite=False),
            ("localize/trajectory.tum",),
        ),
        "run_slam": (
            lambda: run_slam(told, out / "slam", Outlet(), overwrite=False),
            ("slam/map.json", "slam/trajectory.tum"),
        ),
    }
    for stage in stages.split(","):
        function, estimates = work[stage]
        watch.estimates = None if estimates is None else [os.fspath(out / name) for name in estimates]
        watch.opened = []
        function()
        print(json.dumps({"stage": stage, "opened": watch.opened, "is_on_disk": watch.is_on_disk()}), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
