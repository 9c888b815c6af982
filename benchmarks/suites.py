"""The table of suites. One row each: `benchmarks.attempts.Suite` says what a suite is."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.acceleration import Acceleration
from benchmarks.analytic import Analytic
from benchmarks.attempts import Suite
from benchmarks.fclib.suite import Fclib
from benchmarks.impacts.suite import Impacts
from benchmarks.kernels import Kernels
from benchmarks.overhead import Overhead
from benchmarks.presolve.suite import Presolve
from benchmarks.qp import Qp
from benchmarks.scaling import Scaling
from benchmarks.stability.suite import Stability
from benchmarks.stacks_suite import Stacks

SUITES: Mapping[str, Suite] = {
    suite.name: suite
    for suite in (
        Stacks(),
        Stability(),
        Analytic(),
        Fclib(),
        Qp(),
        Impacts(),
        Presolve(),
        Scaling(),
        Acceleration(),
        Kernels(),
        Overhead(),
    )
}
