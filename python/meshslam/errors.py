"""The one tree of errors that users see: each message says what was found, where, and what to do."""


class MeshslamError(Exception):
    """Base of every error that meshslam raises on purpose."""


class SequenceError(MeshslamError):
    """A sequence's files are missing, unreadable or do not agree with each other."""


class DetectionError(MeshslamError):
    """A detection file does not follow the schema."""


class ModelError(MeshslamError):
    """A network cannot be loaded, or its outputs fit no known layout."""


class CategoryError(MeshslamError):
    """A category cannot be found, built or read."""


class MapError(MeshslamError):
    """A map or run directory cannot be read or written."""


class ConfigError(MeshslamError):
    """A configuration file or flag has an unknown key or a wrong value."""


class GeometryError(MeshslamError, ValueError):
    """A shape, index or value handed to the geometry is not usable."""
