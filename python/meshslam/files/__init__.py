"""Files on disk: whole or not there, known by their content, and used by one process at a time."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.files.arrays import arrays_from_bytes, arrays_to_bytes
    from meshslam.files.atomic import (
        LEFTOVER_SUFFIX,
        Content,
        part_of,
        remove_leftovers,
        remove_leftovers_of,
        write_atomically,
        write_into,
        write_together,
        written_aside,
    )
    from meshslam.files.digest import digest_of, digest_of_file
    from meshslam.files.folder import LIST, replaced_folder
    from meshslam.files.lock import LOCK, locked, wait_until_free
    from meshslam.files.places import CITY, map_file, must_exist, real_path
else:
    __getattr__ = deferred(
        __name__,
        {
            "arrays": "arrays_from_bytes arrays_to_bytes",
            "atomic": (
                "LEFTOVER_SUFFIX Content part_of remove_leftovers remove_leftovers_of write_atomically write_into "
                "write_together written_aside"
            ),
            "digest": "digest_of digest_of_file",
            "folder": "LIST replaced_folder",
            "lock": "LOCK locked wait_until_free",
            "places": "CITY map_file must_exist real_path",
        },
    )

__all__ = [
    "CITY",
    "LEFTOVER_SUFFIX",
    "LIST",
    "LOCK",
    "Content",
    "arrays_from_bytes",
    "arrays_to_bytes",
    "digest_of",
    "digest_of_file",
    "locked",
    "map_file",
    "must_exist",
    "part_of",
    "real_path",
    "remove_leftovers",
    "remove_leftovers_of",
    "replaced_folder",
    "wait_until_free",
    "write_atomically",
    "write_into",
    "write_together",
    "written_aside",
]
