"""Multi-body contact as one stacked system A F dt = B, solved and certified."""

from formulations import (
    LCP,
    Certificate,
    ElasticityWarning,
    StackedSystem,
    certify,
    minimum_norm,
    two_body_impulse,
    two_body_impulse_along,
)
from gpx_lcp import scenes
from gpx_lcp._core import BUILD_PROFILE
from gpx_lcp.contacts import Contacts
from gpx_lcp.ensemble import ensemble
from gpx_lcp.errors import BackendError, BackendMissing, GpxLcpError, ProblemError, SettingsError
from gpx_lcp.fclib import FclibProblem, read_fclib, write_fclib
from gpx_lcp.impact import impact
from gpx_lcp.impact_laws import LAWS, Impact
from gpx_lcp.materials import Material
from gpx_lcp.presolve import presolve
from gpx_lcp.presolved import Presolve
from gpx_lcp.scene import Body, Scene
from gpx_lcp.shapes import Box, Capsule, ConvexHull, Cylinder, HalfSpace, Shape, Sphere
from gpx_lcp.solution import Solution, Status
from gpx_lcp.solve import solve
from gpx_lcp.solvers import SolverTable, solvers
from gpx_lcp.solvers.lemke import LCPSolution, solve_lcp
from gpx_lcp.world import World

__all__ = [
    "BUILD_PROFILE",
    "LAWS",
    "LCP",
    "BackendError",
    "BackendMissing",
    "Body",
    "Box",
    "Capsule",
    "Certificate",
    "Contacts",
    "ConvexHull",
    "Cylinder",
    "ElasticityWarning",
    "FclibProblem",
    "GpxLcpError",
    "HalfSpace",
    "Impact",
    "LCPSolution",
    "Material",
    "Presolve",
    "ProblemError",
    "Scene",
    "SettingsError",
    "Shape",
    "Solution",
    "SolverTable",
    "Sphere",
    "StackedSystem",
    "Status",
    "World",
    "certify",
    "ensemble",
    "impact",
    "minimum_norm",
    "presolve",
    "read_fclib",
    "scenes",
    "solve",
    "solve_lcp",
    "solvers",
    "two_body_impulse",
    "two_body_impulse_along",
    "write_fclib",
]
