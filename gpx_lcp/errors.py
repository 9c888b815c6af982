"""Every exception that gpx-lcp raises; those about the question itself come from `formulations`."""

from formulations.errors import GpxLcpError, ProblemError, SettingsError

__all__ = ["BackendError", "BackendMissing", "GpxLcpError", "ProblemError", "SettingsError"]


class BackendMissing(GpxLcpError, ImportError):
    """A solver that is not installed was asked for; the message says which command installs it."""


class BackendError(GpxLcpError):
    """A backend failed in a way of its own; its exception is the cause of this one."""
