"""A typed client of the daemon, for scripts and the command line."""

from bscd.client.async_client import AsyncClient
from bscd.client.client import Client
from bscd.client.connection import DEFAULT_URL
from bscd.client.errors import ApiError, DeviceProblemError, NoDaemonError, NoPermissionError

__all__ = [
    "DEFAULT_URL",
    "ApiError",
    "AsyncClient",
    "Client",
    "DeviceProblemError",
    "NoDaemonError",
    "NoPermissionError",
]
