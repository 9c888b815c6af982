"""Systems with no solution, with several, or with one that is hard to find: what a solver claims is held to the law."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

import gpx_lcp as gpx
from benchmarks.stability.modes import (
    EXACT,
    GRAVITY,
    NO_DILATION,
    TIME_STEP,
    Mode,
    SystemQuestion,
    coulomb_error,
    worst,
)

# Of the largest |B|, line by line of the law; and of a velocity.
LAW, VELOCITY = 1e-4, 1e-4
SPEED = GRAVITY * TIME_STEP


def lawful(system: gpx.StackedSystem) -> SystemQuestion:
    """Return the question whose truth is the law itself, as several answers may obey it."""
    return SystemQuestion(system, lambda p, u: coulomb_error(system, p, u) / LAW)


def parallel_walls(friction: float) -> SystemQuestion:
    """Return a point mass between two parallel walls: any fall from none to free fall is an exact solution."""
    jacobian = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, 1, 0], [0, 0, 1]]
    system = gpx.StackedSystem.from_jacobian(
        jacobian, np.ones(3), [0, 0, SPEED, 0, 0, SPEED], [friction, friction], free_velocity=[0, 0, -SPEED]
    )
    law = lawful(system)

    def error(p: np.ndarray, u: np.ndarray) -> float:
        fall = -float(u[0, 2]) / SPEED
        return worst(law.error(p, u), -fall / VELOCITY, (fall - 1.0) / VELOCITY)

    return SystemQuestion(system, error)


def painleve(friction: float) -> SystemQuestion:
    """Return a uniform rod of 2 m and 1 kg, tip on the ground, that slides tip first at 1 m/s with tan θ = 2.

    With W = A, W_NN - μ W_NT < 0 from μ = 4/3 on: the motion in continuous time has no solution or two.
    """
    x, z = 1.0 / math.sqrt(5.0), -2.0 / math.sqrt(5.0)
    system = gpx.StackedSystem.from_jacobian(
        [[0.0, 1.0, x], [1.0, 0.0, -z]], [1.0, 1.0, 3.0], [SPEED, -1.0], [friction], free_velocity=[1.0, -SPEED, 0.0]
    )
    return lawful(system)


def jam(bodies: float) -> SystemQuestion:
    """Return a row of bodies between two walls that close at 1 m/s each."""
    n = int(bodies)
    jacobian = np.eye(n + 1, n) - np.eye(n + 1, n, -1)
    B = np.zeros(n + 1)
    B[[0, -1]] = 1.0
    system = gpx.StackedSystem.from_jacobian(jacobian, np.ones(n), B, np.zeros(n + 1))
    return SystemQuestion(system, lambda p, u: 2.0, feasible=False)


def fathi(size: float) -> SystemQuestion:
    """Return Fathi's symmetric positive definite problem, on which pivoting may take 2ⁿ steps: z = (1, 0, ..., 0)."""
    n = int(size)
    murty = np.eye(n) + 2.0 * np.tri(n, k=-1)
    truth = np.eye(n)[0]
    system = gpx.StackedSystem(murty @ murty.T, np.ones(n), np.zeros(n))
    return SystemQuestion(system, lambda p, u: float(np.abs(p[:, 0] - truth).max()) / 1e-3)


def conditioned(condition: float) -> SystemQuestion:
    """Return a system of a given condition number whose velocities were chosen first: every other contact opens."""
    n = 20
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.normal(size=(n, n)))[0]
    A = (turn * np.logspace(0.0, -math.log10(condition), n)) @ turn.T
    A = 0.5 * (A + A.T)
    closed = np.arange(n) % 2 == 0
    impulse, truth = np.where(closed, rng.uniform(1.0, 2.0, n), 0.0), np.where(closed, 0.0, rng.uniform(1.0, 2.0, n))
    B = A @ impulse - truth
    system = gpx.StackedSystem(A, B, np.zeros(n))
    return SystemQuestion(system, lambda p, u: float(np.abs(u[:, 0] - truth).max()) / VELOCITY)


def coupled(friction: float) -> SystemQuestion:
    """Return four rough contacts on one linkage of 14 coordinates, in which each moves every other; all close."""
    rng = np.random.default_rng(0)
    jacobian = rng.normal(size=(4, 3, 14))
    velocity = rng.normal(size=14)
    jacobian *= np.where(jacobian[:, 0] @ velocity > 0.0, -1.0, 1.0)[:, None, None]
    flat = jacobian.reshape(12, 14)
    return lawful(gpx.StackedSystem.from_jacobian(flat, np.ones(14), -flat @ velocity, np.full(4, friction)))


def random_law(seed: float) -> SystemQuestion:
    """Return six bodies that touch in eight points at random, after random velocities."""
    rng = np.random.default_rng(int(seed))
    jacobian = np.zeros((8, 3, 6, 6))
    for contact in range(8):
        first, second = rng.choice(6, 2, replace=False)
        jacobian[contact, :, first], jacobian[contact, :, second] = rng.normal(size=(2, 3, 6))
    flat, velocity = jacobian.reshape(24, 36), rng.normal(size=36)
    return lawful(gpx.StackedSystem.from_jacobian(flat, np.ones(36), -flat @ velocity, rng.uniform(0.1, 1.0, 8)))


def struck(rows: float) -> SystemQuestion:
    """Return a brick wall 20 steps after a ball of the bricks' mass hit it from behind with 3 m/s: much of it slides.

    In between it is stepped by sweeps; what is asked is the next step.
    """
    scene = gpx.scenes.wall(int(rows))
    across = np.mean([body.position[0] for body in scene.bodies])
    scene.add_rigid(gpx.Sphere(0.2), 1.0, position=[across, -0.71, 0.6 * rows], velocity=[0.0, 3.0, 0.0])
    world = gpx.World(scene, time_step=TIME_STEP, solver="pgs", tolerance=1e-6, max_iterations=1000)
    world.step(21)
    return lawful(world.system())


LAWFUL, RULE = "Coulomb's law, line by line", "each line of the law within 1e-4 of the largest |B|"
FRICTION = (0, 0.1, 0.5, 1, 2, 5, 10)

MODES: Mapping[str, Mode] = {
    "walls": Mode(
        "F5", "mass between parallel walls", "friction", FRICTION[1:], parallel_walls,
        "the law, and a fall between none and free", RULE,
    ),
    "painleve": Mode(
        "F12", "Painlevé's rod", "friction", (0.5, 1, 1.3, 1.4, 2, 5, 10), painleve, LAWFUL, RULE, programs=NO_DILATION,
    ),
    "jam": Mode(
        "F13", "jam of closing walls", "bodies", (1, 2, 5, 10, 30, 100), jam, "there is no solution",
        "the status INFEASIBLE", frictionless=True,
    ),
    "fathi": Mode(
        "F14", "Fathi's problem", "unknowns", (2, 4, 8, 16, 32, 64, 128), fathi, "z = (1, 0, ..., 0)",
        "z within 1e-3", frictionless=True,
    ),
    "condition": Mode(
        "F15", "ill-conditioned A", "condition", (1e2, 1e4, 1e6, 1e8, 1e10, 1e12), conditioned,
        "the velocities it was made from", "velocities within 1e-4 of theirs", frictionless=True,
    ),
    "coupled": Mode(
        "F24", "rough contacts, all coupled", "friction", FRICTION, coupled, LAWFUL, RULE, programs=EXACT,
    ),
    "random": Mode(
        "F24", "random bodies", "seed", (1, 2, 3, 4, 5, 6, 7, 8), random_law, LAWFUL, RULE, programs=EXACT,
    ),
    "struck": Mode(
        "F31", "wall that is struck", "rows", (2, 4, 6, 8, 10, 14), struck, LAWFUL, RULE, programs=EXACT,
    ),
}  # fmt: skip
