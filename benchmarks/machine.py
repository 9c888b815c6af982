"""Where and with what a row was measured: CPU, versions, threads, build profile, revision."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path

import gpx_lcp as gpx
from benchmarks import THREAD_VARIABLES

ROOT = Path(__file__).resolve().parent.parent


def version_of(distribution: str) -> str:
    """Return the installed version of a distribution, or "" where it is not installed."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return ""


def cpu_name() -> str:
    """Return the processor's name as the operating system tells it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass  # no such file outside Linux
    return platform.processor() or platform.machine()


def revision() -> str:
    """Return the git revision of this checkout, with "+" when it holds changes, or "" outside a checkout."""
    command = ["git", "describe", "--always", "--dirty=+", "--abbrev=10"]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()


def thread_setting() -> str:
    """Return "1" when every thread pool was told to use one thread, else the variables that say otherwise."""
    others = [f"{name}={os.environ[name]}" for name in THREAD_VARIABLES if os.environ.get(name) != "1"]
    return " ".join(others) or "1"


def describe() -> dict[str, str]:
    """Return the columns that are the same for every row of a run."""
    return {
        "cpu": cpu_name(),
        "cores": str(os.cpu_count() or ""),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "numpy": version_of("numpy"),
        "scipy": version_of("scipy"),
        "gpx_lcp": version_of("gpx-lcp"),
        "build_profile": gpx.BUILD_PROFILE,
        "revision": revision(),
        "threads": thread_setting(),
    }


def version_line(where: Mapping[str, str], *more: str) -> str:
    """Return versions and processor of a run, and what else there is to say of it, in one line."""
    return ", ".join(
        [
            f"gpx-lcp {where['gpx_lcp']} ({where['build_profile']} build, {where['revision'] or 'no revision'})",
            f"Python {where['python']}",
            f"numpy {where['numpy']}",
            where["cpu"],
            f"threads: {where['threads']}",
            *more,
        ]
    )
