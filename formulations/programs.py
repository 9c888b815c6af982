"""The names of the programs, and the one way to judge a solution of each by its own equations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

import numpy as np

from formulations.box import box_residual
from formulations.checks import Array
from formulations.cone import cone_residual
from formulations.cones import box_directions, project_friction_cone, project_polyhedral_cone, pyramid_directions
from formulations.coulomb import coulomb_residual
from formulations.normal import normal_residual
from formulations.pyramid import pyramid_qp_residual, pyramid_residual
from formulations.system import StackedSystem

FORMULATIONS: Final = ("normal", "box", "pyramid", "cone", "coulomb")

# Every program takes the facets, although only the pyramids have any, so that nobody has to branch on the name.
RESIDUALS: Final[Mapping[str, Callable[[StackedSystem, Array, int], float]]] = MappingProxyType(
    {
        "normal": lambda system, impulse, facets: normal_residual(system, impulse),
        "box": lambda system, impulse, facets: box_residual(system, impulse),
        "pyramid": pyramid_residual,
        "pyramid_qp": pyramid_qp_residual,
        "cone": lambda system, impulse, facets: cone_residual(system, impulse),
        "coulomb": lambda system, impulse, facets: coulomb_residual(system, impulse),
    }
)

# Onto the impulses that each formulation allows, (impulse, friction, facets) to impulse.
PROJECTIONS: Final[Mapping[str, Callable[[Array, Array, int], Array]]] = MappingProxyType(
    {
        "normal": lambda p, friction, facets: project_friction_cone(p, np.zeros_like(friction)),
        "box": lambda p, friction, facets: project_polyhedral_cone(p, friction, box_directions(p.shape[1])),
        "pyramid": lambda p, friction, facets: project_polyhedral_cone(
            p, friction, pyramid_directions(p.shape[1], facets)
        ),
        "cone": lambda p, friction, facets: project_friction_cone(p, friction),
        "coulomb": lambda p, friction, facets: project_friction_cone(p, friction),
    }
)
