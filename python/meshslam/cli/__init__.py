"""Command line: one thin file a command; the only room that prints or exits."""

from meshslam.cli.app import main

__all__ = ["main"]
