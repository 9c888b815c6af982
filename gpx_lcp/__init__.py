"""Multi-body contact as one stacked system A F dt = B, solved and certified."""

from formulations import StackedSystem
from gpx_lcp._core import BUILD_PROFILE
from gpx_lcp.errors import BackendError, BackendMissing, GpxLcpError, ProblemError, SettingsError

__all__ = [
    "BUILD_PROFILE",
    "BackendError",
    "BackendMissing",
    "GpxLcpError",
    "ProblemError",
    "SettingsError",
    "StackedSystem",
]
