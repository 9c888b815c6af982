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


@pytest.fixture(scope="session")
def bricks():
    """Return a maker of walls of unit cubes, `courses` high and `columns` wide, all bonded, after one step of gravity.

    Every cube meets the one below it, and its neighbour to the right, in four corner contacts: rank 6 of 12 rows.
    """

    def make(
        courses: int, columns: int = 1, *, top: float = 1.0, friction: float = 0.5, speed: float = 0.0
    ) -> StackedSystem:
        frames = {"z": np.roll(np.eye(3), 1, axis=0), "x": np.eye(3)}
        blocks: dict[tuple[int, int], np.ndarray] = {}
        contact = 0

        def touch(first: int | None, second: int, centre: np.ndarray, axis: str) -> None:
            nonlocal contact
            for corner in ((-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)):
                point = centre + (np.array([0.0, *corner]) if axis == "x" else np.array([*corner, 0.0]))
                for body, sign in ((first, -1.0), (second, 1.0)):
                    if body is not None:
                        arm = point - np.array([body % columns, 0.0, body // columns])
                        blocks[contact, body] = sign * np.hstack((frames[axis], np.cross(arm, frames[axis])))
                contact += 1

        for body in range(courses * columns):
            place = np.array([body % columns, 0.0, body // columns])
            touch(body - columns if body >= columns else None, body, place - [0.0, 0.0, 0.5], "z")
            if body % columns:
                touch(body - 1, body, place - [0.5, 0.0, 0.0], "x")
        bodies = courses * columns
        jacobian = np.zeros((3 * contact, 6 * bodies))
        for (row, body), block in blocks.items():
            jacobian[3 * row : 3 * row + 3, 6 * body : 6 * body + 6] = block
        mass = np.ones(bodies)
        mass[-1] = top
        inverse_mass = np.repeat(1.0 / mass, 6).reshape(bodies, 6) * np.array([1.0, 1.0, 1.0, 6.0, 6.0, 6.0])
        free = speed * np.random.default_rng(7).normal(size=(bodies, 6))
        free[:, 2] -= 9.81 / 240
        free = free.reshape(-1)
        return StackedSystem.from_jacobian(
            jacobian, inverse_mass.reshape(-1), -jacobian @ free, np.full(contact, friction), free_velocity=free
        )

    return make
