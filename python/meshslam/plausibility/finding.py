"""What a judgement finds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

from meshslam.errors import SequenceError

Severity = Literal["error", "note"]


@dataclass(frozen=True)
class Finding:
    """Something of an input that cannot be right, or that its user should know.

    An error makes results wrong: runs stop. A note is something that a run can handle. `code` is short and stable;
    `message` says what was found, where, and what to do; `figures` are the numbers behind it.
    """

    code: str
    message: str
    severity: Severity = "error"
    figures: dict[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.message


def errors(findings: Iterable[Finding]) -> list[Finding]:
    """The findings that runs stop at."""
    return [finding for finding in findings if finding.severity == "error"]


def notes(findings: Iterable[Finding]) -> list[Finding]:
    """The findings that runs only tell."""
    return [finding for finding in findings if finding.severity == "note"]


def raise_errors(findings: Iterable[Finding]) -> None:
    """SequenceError with the first error, and how many there are beside it."""
    found = errors(findings)
    if found:
        more = f" (and {len(found) - 1} more: meshslam check lists all)" if len(found) > 1 else ""
        raise SequenceError(f"{found[0].message}{more}")
