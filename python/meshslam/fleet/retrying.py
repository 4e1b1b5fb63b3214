"""Which losses are repeated: machines fail by chance, a drive that is wrong is wrong again.

An outcome is never repeated, good or bad. A worker that ran out of memory is tried once more, since its neighbours may
have taken the memory.
"""

from __future__ import annotations

from collections.abc import Sequence

from meshslam.fleet.jobs import Loss


def is_repeated(loss: Loss, earlier: Sequence[Loss], retries: int) -> bool:
    """Whether a drive's step that was lost begins again; `earlier` are the drive's losses before."""
    if loss.kind == "memory" and any(other.kind == "memory" for other in earlier):
        return False
    return len(earlier) < retries


def why_not(losses: Sequence[Loss]) -> str:
    """Why it is not tried once more."""
    if losses[-1].kind == "memory":
        return "it needs more memory: name what it needs under `resources`, or give fewer --workers"
    return f"not tried again after {len(losses)} losses (--retries)" if len(losses) > 1 else "not tried again"
