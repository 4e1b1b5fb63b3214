"""What became of a Ray task: its outcome, the loss of its worker or node, or an error before the job began."""

from __future__ import annotations

from typing import Any

from meshslam.fleet.jobs import Loss, Outcome


def result_of(ray: Any, reference: Any) -> Outcome | Loss:  # noqa: ANN401 # the module, and a reference of it
    """The outcome of a task that has ended; what Ray raises instead is a loss, or a reason."""
    exceptions = ray.exceptions
    try:
        found: Outcome = ray.get(reference)
    except exceptions.OutOfMemoryError as error:
        return Loss("memory", f"Ray killed its worker, as the node ran out of memory ({_short(error)})")
    except exceptions.RayTaskError as error:  # the job itself never raises: the package may be missing there
        return Outcome(reason=f"the node cannot begin the job: {_short(error.cause or error)}")
    except exceptions.RuntimeEnvSetupError as error:
        return Outcome(reason=f"the node cannot begin the job: {_short(error)}")
    except exceptions.NodeDiedError as error:
        return Loss("worker", f"its node was lost ({_short(error)})")
    except exceptions.ObjectLostError as error:
        return Loss("worker", f"its result was lost with its node ({_short(error)})")
    except exceptions.RayError as error:
        return Loss("worker", f"its worker was lost ({type(error).__name__}: {_short(error)})")
    return found


def _short(error: BaseException) -> str:
    """The first sentence, in one line."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return (lines[0].partition(". ")[0] if lines else type(error).__name__)[:200]
