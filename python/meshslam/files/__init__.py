"""Files on disk: whole or not there, known by their content, and used by one process at a time."""

from meshslam.files.atomic import (
    LEFTOVER_SUFFIX,
    remove_leftovers,
    remove_leftovers_of,
    write_atomically,
    write_into,
    write_together,
    written_aside,
)
from meshslam.files.digest import digest_of, digest_of_file
from meshslam.files.folder import LIST, replaced_folder
from meshslam.files.lock import LOCK, locked
from meshslam.files.places import real_path

__all__ = [
    "LEFTOVER_SUFFIX",
    "LIST",
    "LOCK",
    "digest_of",
    "digest_of_file",
    "locked",
    "real_path",
    "remove_leftovers",
    "remove_leftovers_of",
    "replaced_folder",
    "write_atomically",
    "write_into",
    "write_together",
    "written_aside",
]
