"""The mathematics of gpx-lcp: the stacked system, every program it can be posed as, and the certificate.

Read `system` first (A F dt = B), then `coulomb` (the law), then the programs that approximate it, one file each:
`normal`, `box`, `pyramid`, `cone`. `certificate` judges all of them by the same law; `two_body` is where it began.
"""

from formulations.box import box_impulse, box_lcp, box_residual
from formulations.certificate import Certificate, certify
from formulations.cone import cone_qp, cone_residual, cone_rows
from formulations.coulomb import coulomb_residual
from formulations.errors import GpxLcpError, ProblemError, SettingsError
from formulations.existence import Refutation, refutation
from formulations.lcp import LCP
from formulations.least_norm import minimum_norm
from formulations.normal import normal_impulse, normal_lcp, normal_qp, normal_residual
from formulations.programs import FORMULATIONS, PROJECTIONS, RESIDUALS
from formulations.pyramid import (
    DEFAULT_FACETS,
    pyramid_impulse,
    pyramid_lcp,
    pyramid_qp,
    pyramid_qp_residual,
    pyramid_residual,
)
from formulations.qp import QP
from formulations.redundancy import Uniqueness, uniqueness
from formulations.system import StackedSystem
from formulations.two_body import ElasticityWarning, pair_elasticity, two_body_impulse, two_body_impulse_along

__all__ = [
    "DEFAULT_FACETS",
    "FORMULATIONS",
    "LCP",
    "PROJECTIONS",
    "QP",
    "RESIDUALS",
    "Certificate",
    "ElasticityWarning",
    "GpxLcpError",
    "ProblemError",
    "Refutation",
    "SettingsError",
    "StackedSystem",
    "Uniqueness",
    "box_impulse",
    "box_lcp",
    "box_residual",
    "certify",
    "cone_qp",
    "cone_residual",
    "cone_rows",
    "coulomb_residual",
    "minimum_norm",
    "normal_impulse",
    "normal_lcp",
    "normal_qp",
    "normal_residual",
    "pair_elasticity",
    "pyramid_impulse",
    "pyramid_lcp",
    "pyramid_qp",
    "pyramid_qp_residual",
    "pyramid_residual",
    "refutation",
    "two_body_impulse",
    "two_body_impulse_along",
    "uniqueness",
]
