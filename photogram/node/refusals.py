"""What a node does not do."""

from photogram.errors import PhotogramError


class RequestError(PhotogramError, ValueError):
    """A request that cannot be fulfilled, with the reason: what NodeODM answers as ``{"error": …}``."""
