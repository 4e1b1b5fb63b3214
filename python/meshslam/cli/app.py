"""The commands, and how an error ends them."""

from __future__ import annotations

import atexit
import os
import signal
import sys
import tempfile
import traceback
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from meshslam.cli.category import category_app
from meshslam.cli.check import check
from meshslam.cli.compare import compare
from meshslam.cli.convert import convert
from meshslam.cli.demo import demo
from meshslam.cli.detect import detect
from meshslam.cli.evaluate import evaluate
from meshslam.cli.export import export
from meshslam.cli.fleet import fleet_app
from meshslam.cli.localize import localize
from meshslam.cli.map import map_
from meshslam.cli.merge import merge
from meshslam.cli.models import models_app
from meshslam.cli.quiet import can_be_quiet
from meshslam.cli.reproduce import reproduce_app
from meshslam.cli.ros2 import RosCommand, ros2
from meshslam.cli.simulate import simulate
from meshslam.cli.slam import slam
from meshslam.cli.train_keypoints import train_keypoints
from meshslam.cli.version import version
from meshslam.cli.view import view
from meshslam.errors import MeshslamError

THREADS = "OPENBLAS_NUM_THREADS"  # of NumPy's and SciPy's linear algebra
USER_ERROR, FAULT, INTERRUPTED = 2, 70, 130


class _Interrupted(BaseException):
    """Ctrl-C; typer would end a KeyboardInterrupt itself, without a word."""


class _Commands(TyperGroup):
    """Commands whose Ctrl-C `main` tells. Until here it is a KeyboardInterrupt: native code knows no other."""

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401 # typer's
        """Run the command."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise _Interrupted from error


app = typer.Typer(
    name="meshslam",
    cls=_Commands,
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(wanted: bool) -> None:
    if wanted:
        version()
        raise typer.Exit


@app.callback()
def options(
    shown: Annotated[
        bool, typer.Option("--version", help="Print the version.", is_eager=True, callback=_show_version)
    ] = False,
) -> None:
    """Object-level SLAM with instance-specific meshes: maps in which every car has its pose and its own shape."""


app.command("map")(can_be_quiet(map_))
app.command("localize")(can_be_quiet(localize))
app.command("slam")(can_be_quiet(slam))
app.command("merge")(can_be_quiet(merge))
app.command("detect")(can_be_quiet(detect))
app.command("convert")(can_be_quiet(convert))
app.command("evaluate")(evaluate)
app.command("compare")(compare)
app.command("check")(check)
app.command("export")(can_be_quiet(export))
app.command("view")(view)
app.command("simulate")(can_be_quiet(simulate))
app.command("demo")(can_be_quiet(demo))
app.command("ros2", cls=RosCommand)(ros2)
app.command("train-keypoints")(train_keypoints)
app.command("version")(version)
app.add_typer(category_app, name="category")
app.add_typer(fleet_app, name="fleet")
app.add_typer(models_app, name="models")
app.add_typer(reproduce_app, name="reproduce")


def main() -> None:
    """Run a command; a user's mistake is one line on stderr and exit code 2, never a traceback."""
    one_blas_thread()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    try:
        app()
    except SystemExit:
        atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)  # all is done: Python's end has no word for it
        raise
    except BaseException as error:  # the last place where it can be told
        _end(*_told(error))


def _told(error: BaseException) -> tuple[str, int]:
    """What an exception says to the user, and the exit code."""
    if _is_interrupt(error):
        return "interrupted: what is written is whole; the same command again goes on from there", INTERRUPTED
    if isinstance(error, MeshslamError):
        return f"error: {error}", USER_ERROR
    if isinstance(error, OSError):
        where = f" {error.filename}" if error.filename else ""
        return f"error:{where}: {error.strerror or error}", USER_ERROR
    if isinstance(error, MemoryError):
        return "error: out of memory: give fewer frames, or lower objects.max_views in the configuration", USER_ERROR
    return f"error: {_fault(error)}", FAULT


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether Ctrl-C is behind it: while native code is imported it becomes an ImportError."""
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        if isinstance(error, KeyboardInterrupt | _Interrupted):
            return True
        seen.add(id(error))
        error = error.__cause__ or error.__context__
    return False


def one_blas_thread() -> None:
    """Let OpenBLAS work in one thread, unless the user chose: a run's matrices are small, more threads only wait.

    It holds for a NumPy that is imported later. The core's own threads stay as they are.
    """
    if not any(name in os.environ for name in (THREADS, "OMP_NUM_THREADS", "GOTO_NUM_THREADS")):
        os.environ[THREADS] = "1"


def _fault(error: BaseException) -> str:
    """A fault of ours in one line; the traceback lies in a file of its own."""
    with tempfile.NamedTemporaryFile("w", prefix="meshslam-fault-", suffix=".txt", delete=False) as file:
        traceback.print_exception(error, file=file)
    said = " ".join(str(error).split())[:150]
    return (
        f"{type(error).__name__}: {said}: this is a fault of meshslam, which should have said what is wrong with the "
        f"input: please report it with {file.name}"
    )


def _end(message: str, code: int) -> None:
    sys.stdout.flush()
    print(message, file=sys.stderr, flush=True)
    if code == INTERRUPTED:
        os._exit(code)  # worker threads may be in the middle of native code
    sys.exit(code)
