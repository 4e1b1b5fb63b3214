"""`--quiet`: errors and notes only."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer

_chosen = {"quiet": False}
_Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Say notes and errors only: no progress, no figures.", show_default=False)
]


def is_quiet() -> bool:
    """Whether progress and figures are not to be shown."""
    return _chosen["quiet"]


def can_be_quiet(command: Callable[..., None]) -> Callable[..., None]:
    """A command with the flag `--quiet`."""
    own = inspect.signature(command, eval_str=True)
    flag = inspect.Parameter("quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=_Quiet)
    kept = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in own.parameters.values()]

    @functools.wraps(command)
    def taken(**given: Any) -> None:  # noqa: ANN401 # whatever the flags hold
        _chosen["quiet"] = given.pop("quiet")
        command(**given)

    taken.__signature__ = own.replace(parameters=[*kept, flag])  # type: ignore[attr-defined] # typer reads it
    taken.__annotations__ = {p.name: p.annotation for p in [*kept, flag]}
    del taken.__wrapped__
    return taken
