"""The mathematics of gpx-lcp: the stacked system, every program it can be posed as, and the certificate."""

from formulations.errors import GpxLcpError, ProblemError, SettingsError
from formulations.system import StackedSystem

__all__ = ["GpxLcpError", "ProblemError", "SettingsError", "StackedSystem"]
