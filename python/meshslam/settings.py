"""Settings: dataclass fields with a unit and a range, which are checked wherever a configuration is made.

A run's settings are of two kinds. `public` ones are those that users of a camera, a car or a drive have reason to
change. `expert` ones tune the method. Fields of other configurations are plain `setting`s.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cache, cached_property
from numbers import Integral, Real
from types import NoneType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from meshslam.errors import ConfigError

T = TypeVar("T")
Kind = Literal["public", "expert", "plain"]
Bound = float | str | None  # a number, or the name of another field of the same class

_UNITS = {
    "_m_s2": "m/s²",
    "_rad_s2": "rad/s²",
    "_m_s": "m/s",
    "_rad_s": "rad/s",
    "_hz": "Hz",
    "_m": "m",
    "_px": "px",
    "_s": "s",
    "_deg": "deg",
    "_rad": "rad",
}
_TOO_LARGE = 2**63  # for the core's integers
_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


@dataclass(frozen=True)
class Bounds:
    """The range of a number; `low` and `high` belong to it, `above` and `below` do not."""

    low: Bound = None
    above: Bound = None
    high: Bound = None
    below: Bound = None

    def hold(self, value: float, others: Mapping[str, Any]) -> bool:
        """Whether a number is in range; `others` are the values of the fields that bounds may name."""
        return all(within(value, others[b] if isinstance(b, str) else b) for within, b in self._given)

    @cached_property
    def _given(self) -> tuple[tuple[Callable[[Any, Any], bool], float | str], ...]:
        every = (
            (operator.ge, self.low),
            (operator.gt, self.above),
            (operator.le, self.high),
            (operator.lt, self.below),
        )
        return tuple((within, bound) for within, bound in every if bound is not None)

    @cached_property
    def text(self) -> str:
        """The range in words, such as `from 0 to 1`; empty where every number will do."""
        if self.low is not None and self.high is not None:
            return f"from {_bound(self.low)} to {_bound(self.high)}"
        words = {"at least": self.low, "above": self.above, "at most": self.high, "below": self.below}
        return " and ".join(f"{word} {_bound(bound)}" for word, bound in words.items() if bound is not None)


@dataclass(frozen=True)
class About:
    """What a field's declaration says beside its type and default."""

    kind: Kind
    unit: str | None
    bounds: Bounds
    doc: str


def public(
    default: T,
    *,
    doc: str,
    unit: str | None = None,
    low: Bound = None,
    above: Bound = None,
    high: Bound = None,
    below: Bound = None,
) -> T:
    """A field that users have reason to change; a unit that its name ends with need not be given."""
    return field(default=default, metadata={"about": About("public", unit, Bounds(low, above, high, below), doc)})


def expert(
    default: T,
    *,
    unit: str | None = None,
    low: Bound = None,
    above: Bound = None,
    high: Bound = None,
    below: Bound = None,
) -> T:
    """A field that tunes the method; the comment behind it says what it is."""
    return field(default=default, metadata={"about": About("expert", unit, Bounds(low, above, high, below), "")})


def setting(
    default: T,
    *,
    unit: str | None = None,
    low: Bound = None,
    above: Bound = None,
    high: Bound = None,
    below: Bound = None,
) -> T:
    """A field of a configuration that has no kinds of settings; the comment behind it says what it is."""
    return field(default=default, metadata={"about": About("plain", unit, Bounds(low, above, high, below), "")})


@dataclass(frozen=True)
class Setting:
    """One field: what it is called, what it may hold and what it holds if nobody says."""

    name: str
    hint: Any
    default: Any
    about: About

    @cached_property
    def unit(self) -> str:
        """As declared, or as the name ends; empty for counts, shares and what is no number."""
        if self.about.unit is not None:
            return self.about.unit
        return next((unit for ending, unit in _UNITS.items() if self.name.endswith(ending)), "")

    @cached_property
    def expected(self) -> str:
        """What the field takes, in words, such as `a number above 0 (s)`."""
        if self.literals:
            return " or ".join(self.literals)
        words = " or ".join(_WORDS[kind] for kind in self.types)
        range_ = self.about.bounds.text
        range_ = f" of {range_}" if range_.startswith("at ") else f" {range_}" if range_ else ""
        unit = f" ({self.unit})" if self.unit else ""
        listed = f"a list, each {words}" if self.is_list else words
        return f"{listed}{range_}{unit}" + (" or null" if self.takes_none else "")

    @cached_property
    def types(self) -> tuple[type, ...]:
        """Of the value, or of a list's entries."""
        options = get_args(self.hint) or (self.hint,)
        return tuple(option for option in options if option in _WORDS)

    @cached_property
    def literals(self) -> tuple[str, ...]:
        """The words that it may be; empty where it is no choice of words."""
        return get_args(self.hint) if get_origin(self.hint) is Literal else ()

    @cached_property
    def takes_none(self) -> bool:
        """Whether it may be left open."""
        return NoneType in get_args(self.hint)

    @cached_property
    def is_list(self) -> bool:
        """Whether it holds several values."""
        return get_origin(self.hint) is tuple

    def problem(self, value: object, others: Mapping[str, Any]) -> str | None:
        """What is wrong with a value, in words; None if nothing is. `others` are the other fields' values."""
        if self.is_list:
            wrong = not isinstance(value, tuple) or not all(self._takes(entry, others) for entry in value)
        else:
            wrong = not (value is None and self.takes_none) and not self._takes(value, others)
        if not wrong:
            return None
        known = "" if self.default is None or self.is_list else f" (default {_shown(self.default)})"
        return f"expected {self.expected}, found {_shown(value)}{known}"

    def _takes(self, value: object, others: Mapping[str, Any]) -> bool:
        if self.literals:
            return value in self.literals
        if isinstance(value, bool) or not isinstance(value, Real):
            return type(value) in self.types
        if isinstance(value, Integral):
            right = bool({int, float} & set(self.types)) and abs(int(value)) < _TOO_LARGE
        else:
            right = float in self.types and math.isfinite(value)
        return right and self.about.bounds.hold(float(value), others)


@dataclass(frozen=True)
class Settings:
    """Base of every configuration: ConfigError names the class and the field of a value that is out of range."""

    def __post_init__(self) -> None:
        """Check every field."""
        kind: type = type(self)
        values = vars(self)
        for name, known in settings_of(kind).items():
            problem = known.problem(values[name], values)
            if problem is not None:
                raise ConfigError(f"{kind.__name__}.{name}: {problem}")
        for name, part in parts_of(kind).items():
            if not isinstance(values[name], part):
                raise ConfigError(f"{kind.__name__}.{name}: expected a {part.__name__}, found {_shown(values[name])}")


@cache
def settings_of(kind: type) -> dict[str, Setting]:
    """The settings of a class by their names, without those of its parts."""
    hints = get_type_hints(kind)
    return {f.name: Setting(f.name, hints[f.name], f.default, f.metadata["about"]) for f in fields(kind) if f.metadata}


@cache
def parts_of(kind: type) -> dict[str, type[Settings]]:
    """The configurations that a class is made of, by their names."""
    hints = get_type_hints(kind)
    return {f.name: hints[f.name] for f in fields(kind) if not f.metadata}


def paths_of(kind: type, before: str = "") -> dict[str, Setting]:
    """All settings of a class and of its parts by their dotted paths, such as `slam.points.corners`."""
    found = {f"{before}{name}": known for name, known in settings_of(kind).items()}
    for name, part in parts_of(kind).items():
        found |= paths_of(part, f"{before}{name}.")
    return found


def _bound(bound: Bound) -> str:
    return bound if isinstance(bound, str) else f"{bound:g}"


_LONGEST_SHOWN = 100  # characters


def _shown(value: object) -> str:
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, float):
        return repr(float(value)).removesuffix(".0")
    try:
        text = repr(list(value) if isinstance(value, tuple) else value)
    except ValueError:  # an integer of more digits than Python writes
        return "a number of thousands of digits"
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}..."
