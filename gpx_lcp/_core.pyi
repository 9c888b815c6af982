"""The native core; every name here is wrapped by a public one in `gpx_lcp`."""

__all__ = ["BUILD_PROFILE"]

BUILD_PROFILE: str
