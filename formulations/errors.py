"""What can be wrong with a question. Not converging is no error: it is a status."""


class GpxLcpError(Exception):
    """Everything that gpx-lcp raises on purpose."""


class ProblemError(GpxLcpError, ValueError):
    """A system, a scene or an impulse is not what the equations need."""


class SettingsError(GpxLcpError, ValueError):
    """A setting is unknown, of the wrong kind or out of its range."""
