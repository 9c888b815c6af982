"""What several tests share: random systems, chains known on paper, and the folder of real problems."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from formulations import StackedSystem

settings.register_profile("default", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("default")


@pytest.fixture(scope="session")
def problems() -> Path:
    folder = Path(__file__).resolve().parents[2] / "shared" / "problems"
    if not folder.is_dir():
        pytest.skip("the folder of real contact problems is not here")
    return folder


@pytest.fixture(scope="session")
def random_system():
    """Return a maker of systems: `bodies` of six velocities, random contacts, friction in (0, 1)."""

    def make(seed: int, contacts: int = 6, bodies: int = 4, rows: int = 3) -> StackedSystem:
        rng = np.random.default_rng(seed)
        jacobian = np.zeros((rows * contacts, 6 * bodies))
        for contact in range(contacts):
            first, second = rng.choice(bodies, 2, replace=False)
            for body, sign in ((first, -1.0), (second, 1.0)):
                block = sign * rng.normal(size=(rows, 6))
                jacobian[rows * contact : rows * (contact + 1), 6 * body : 6 * body + 6] = block
        free = rng.normal(size=6 * bodies)
        return StackedSystem.from_jacobian(
            jacobian,
            rng.uniform(0.5, 2.0, 6 * bodies),
            -jacobian @ free,
            rng.uniform(0.0, 1.0, contacts),
            free_velocity=free,
        )

    return make


@pytest.fixture(scope="session")
def column():
    """Return a maker of columns: n point masses on one axis, the lowest on the ground, after one step of gravity."""

    def make(n: int, mass: float = 1.0, step: float = 9.81 / 240, top: float = 1.0) -> StackedSystem:
        jacobian = np.eye(n) - np.eye(n, k=-1)
        masses = np.full(n, mass)
        masses[-1] *= top
        free = np.full(n, -step)
        return StackedSystem.from_jacobian(jacobian, 1.0 / masses, -jacobian @ free, np.zeros(n), free_velocity=free)

    return make
