"""How many problems are put into one number or one curve: performance profiles and geometric means.

Source: E. D. Dolan, J. J. Moré, *Benchmarking optimization software with performance profiles*, Math. Program. 91
(2002).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from benchmarks.interface import Array


def performance_ratios(times: npt.ArrayLike) -> Array:
    """Return r_ps = t_ps / min_s t_ps.

    Parameters
    ----------
    times : (problems, solvers) array, s
        Infinite where a solver did not solve a problem.

    Returns
    -------
    (problems, solvers) array; infinite where the solver, or every one, did not solve the problem.
    """
    seconds = np.asarray(times, dtype=np.float64)
    best = seconds.min(axis=1, keepdims=True)
    ratios: Array = np.divide(seconds, best, out=np.full_like(seconds, np.inf), where=np.isfinite(seconds))
    return ratios


def profile(ratios: npt.ArrayLike) -> tuple[Array, Array]:
    """Return the steps of ρ_s(τ) = |{p : r_ps ≤ τ}| / |P|, the share of all problems solved within τ times the best.

    Parameters
    ----------
    ratios : (problems,) array
        Of one solver.

    Returns
    -------
    τ, rising, and ρ from there on. Unsolved problems stay in the denominator.
    """
    finite = [ratio for ratio in np.asarray(ratios, dtype=np.float64) if np.isfinite(ratio)]
    tau, counts = np.unique(finite, return_counts=True)
    return tau, np.cumsum(counts) / max(np.size(ratios), 1)


def shifted_mean(seconds: Sequence[float], shift: float) -> float:
    """Return the shifted geometric mean exp(mean log(t + shift)) - shift: times far below the shift hardly count."""
    return float(np.exp(np.mean(np.log(np.asarray(seconds) + shift))) - shift)


def geometric_mean(ratios: Sequence[float]) -> float:
    """Return exp(mean log r)."""
    return float(np.exp(np.mean(np.log(ratios))))
