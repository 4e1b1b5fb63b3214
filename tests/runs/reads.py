"""Which settings a run reads: a hook on every configuration that knows where in the tree it came from."""

import dataclasses
import sys
from contextlib import contextmanager

from meshslam.settings import Settings, parts_of, settings_of

_OWN = {"dataclasses", "meshslam.settings", "meshslam.runs.settings", "copy"}


@dataclasses.dataclass
class Place:
    """Where in the tree a configuration belongs; what was changed in it is not the tree's any more."""

    instance: Settings  # kept, so that its id stays its own
    path: str
    changed: frozenset = frozenset()


class Reads:
    """The dotted paths of the settings that were read."""

    def __init__(self, config):
        self.paths, self._places = set(), {}
        self._add(config, "")

    def _add(self, config, path):
        self._places[id(config)] = Place(config, path)
        for name in parts_of(type(config)):
            self._add(vars(config)[name], f"{path}{name}.")

    def note_read(self, config, name, caller):
        """A field was read by a function that is no part of the machinery."""
        place = self._places.get(id(config))
        if place is None or name in place.changed or name not in settings_of(type(config)):
            return
        if caller.f_globals["__name__"] not in _OWN and caller.f_code.co_filename != "<string>":
            self.paths.add(f"{place.path}{name}")

    def note_made(self, config, caller):
        """A configuration was made: by `dataclasses.replace` it is where its model was."""
        for _ in range(3):
            caller = caller.f_back
            if caller is not None and caller.f_code.co_name in ("replace", "_replace"):
                model = caller.f_locals.get("obj", caller.f_locals.get("self"))
                place = self._places.get(id(model))
                if place is not None:
                    others = {name for name, value in vars(config).items() if value is not vars(model)[name]}
                    self._places[id(config)] = Place(config, place.path, place.changed | others)
                return


@contextmanager
def recorded(config, monkeypatch):
    """Note what is read of a configuration and of what is derived from it."""
    reads, check = Reads(config), Settings.__post_init__

    def made(self):
        check(self)
        reads.note_made(self, sys._getframe(1))

    def read(self, name):
        if not name.startswith("_"):
            reads.note_read(self, name, sys._getframe(1))
        return object.__getattribute__(self, name)

    with monkeypatch.context() as patch:
        patch.setattr(Settings, "__post_init__", made)
        patch.setattr(Settings, "__getattribute__", read, raising=False)
        yield reads
