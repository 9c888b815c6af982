"""The bodies of a world and how they are changed between two steps: they come, leave, are moved and pushed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from formulations.checks import Array, as_array, freeze
from gpx_lcp import _core
from gpx_lcp.errors import ProblemError
from gpx_lcp.inhabitants import Inhabitants, table
from gpx_lcp.scene import Body, checked_orientation


class Population:
    """The part of a World that is about its bodies. Their state is kept by the core, and copied out when it is read."""

    _core: _core.World
    _inhabitants: Inhabitants
    _forces: Array

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The moving bodies as they were added, in the order of the arrays."""
        return self._inhabitants.bodies

    @property
    def fixed(self) -> tuple[Body, ...]:
        """The bodies that never move."""
        return self._inhabitants.fixed

    @property
    def positions(self) -> Array:
        """Centres of mass, (bodies, 3), m."""
        return freeze(self._core.positions)

    @positions.setter
    def positions(self, value: npt.ArrayLike) -> None:
        self._core.place(0, as_array("positions", value, (len(self.bodies), 3)), None, None)

    @property
    def orientations(self) -> Array:
        """Unit quaternions w, x, y, z from the body's frame to the world's, (bodies, 4)."""
        return freeze(self._core.orientations)

    @orientations.setter
    def orientations(self, value: npt.ArrayLike) -> None:
        rows = as_array("orientations", value, (len(self.bodies), 4))
        checked = [checked_orientation(body.name, row) for body, row in zip(self.bodies, rows, strict=True)]
        self._core.place(0, None, np.array(checked).reshape(-1, 4), None)

    @property
    def velocities(self) -> Array:
        """Linear (m/s) and angular (rad/s) velocities, world frame, (bodies, 6)."""
        return freeze(self._core.velocities)

    @velocities.setter
    def velocities(self, value: npt.ArrayLike) -> None:
        self._core.place(0, None, None, as_array("velocities", value, (len(self.bodies), 6)))

    @property
    def forces(self) -> Array:
        """Forces (N) and torques (N m) that act in every step, world frame, (bodies, 6)."""
        return self._forces

    @forces.setter
    def forces(self, value: npt.ArrayLike) -> None:
        self._forces = as_array("forces", value, (len(self.bodies), 6))

    def add(self, body: Body) -> Body:
        """Add a body that a Scene has made: `ball = world.add(gpx.Scene().add_rigid(gpx.Sphere(0.5), 1.0))`.

        It starts where it was added to its scene, with the velocity, force and torque that it has there. Contacts of
        the other bodies keep their impulses for the warm start.

        Returns
        -------
        Body
            The same with its row in the arrays of this world, one of `world.bodies` or `world.fixed` from now on.
        """
        if not isinstance(body, Body):
            raise ProblemError(f"body is a {type(body).__name__}: a Body, as Scene.add_rigid makes it, is needed")
        inhabitants, added = self._inhabitants.with_body(body)
        if added.index < 0:
            self._core.add(inhabitants.core, None)
        else:
            names = ("position", "orientation", "velocity", "angular_velocity")
            self._core.add(inhabitants.core, np.concatenate([getattr(added, name) for name in names]))
            self._forces = np.vstack((self._forces, table((added,), "force", "torque")))
        self._inhabit(inhabitants)
        return added

    def remove(self, body: Body | str | int) -> None:
        """Remove a body.

        The moving bodies behind it move up by one row: take them from `world.bodies` again, which has them with their
        new index. Contacts that stay keep their impulses for the warm start.

        Parameters
        ----------
        body : Body, str or int
            One of `world.bodies` or `world.fixed`, or its name, or the row of a moving one.
        """
        number = self._inhabitants.number(body)
        inhabitants = self._inhabitants.without_body(number)
        self._core.remove(inhabitants.core, number)
        if number < len(self.bodies):
            self._forces = np.delete(self._forces, number, axis=0)
        self._inhabit(inhabitants)

    def move(
        self,
        body: Body | str | int,
        *,
        position: npt.ArrayLike | None = None,
        orientation: npt.ArrayLike | None = None,
        velocity: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
    ) -> None:
        """Put a moving body somewhere else or give it another velocity, at once; what is not given stays.

        `positions`, `orientations` and `velocities` may be set as a whole, too.

        Parameters
        ----------
        body : Body, str or int
            One of `world.bodies`, or its name or row.
        position, orientation, velocity, angular_velocity
            As in `Body`.
        """
        moving = self._inhabitants.moving(body)
        row, name = moving.index, moving.name
        place = turn = twist = None
        if position is not None:
            place = as_array(f"position of {name}", position, (3,))[None]
        if orientation is not None:
            turn = np.asarray(checked_orientation(name, orientation), dtype=np.float64)[None]
        if velocity is not None or angular_velocity is not None:
            twist = self._core.velocities[row : row + 1]
        if twist is not None and velocity is not None:
            twist[0, :3] = as_array(f"velocity of {name}", velocity, (3,))
        if twist is not None and angular_velocity is not None:
            twist[0, 3:] = as_array(f"angular_velocity of {name}", angular_velocity, (3,))
        self._core.place(row, place, turn, twist)

    def apply_force(
        self,
        body: Body | str | int,
        force: npt.ArrayLike = (0.0, 0.0, 0.0),
        *,
        torque: npt.ArrayLike = (0.0, 0.0, 0.0),
        point: npt.ArrayLike | None = None,
    ) -> None:
        """Add a force and a torque to those that act on a body in every step from now on: to its row of `forces`.

        Parameters
        ----------
        body : Body, str or int
            One of `world.bodies`, or its name or row.
        force : (3,) array, N
            World frame.
        torque : (3,) array, N m
            World frame.
        point : (3,) array, m, optional
            Where the force acts, world frame; the centre of mass unless given. Its torque is that of the body's present
            position and does not follow the body as it moves.
        """
        moving = self._inhabitants.moving(body)
        self._forces[moving.index] += self._wrench(moving, "force", force, "torque", torque, point)

    def apply_impulse(
        self,
        body: Body | str | int,
        impulse: npt.ArrayLike = (0.0, 0.0, 0.0),
        *,
        angular_impulse: npt.ArrayLike = (0.0, 0.0, 0.0),
        point: npt.ArrayLike | None = None,
    ) -> None:
        """Change the velocity of a body at once, by M⁻¹ times an impulse (N s) and an angular impulse (N m s).

        The parameters are those of `apply_force`. A body that does not rotate keeps its angular velocity.
        """
        moving = self._inhabitants.moving(body)
        wrench = self._wrench(moving, "impulse", impulse, "angular_impulse", angular_impulse, point)
        velocity = self._core.velocities[moving.index]
        velocity[:3] += wrench[:3] / moving.mass
        if moving.inertia.any():
            w, *xyz = self._core.orientations[moving.index]
            turn = Rotation.from_quat([*xyz, w])
            velocity[3:] += turn.apply(np.linalg.solve(moving.inertia, turn.inv().apply(wrench[3:])))
        self.move(moving, velocity=velocity[:3], angular_velocity=velocity[3:])

    def _wrench(
        self,
        body: Body,
        linear_name: str,
        linear: npt.ArrayLike,
        angular_name: str,
        angular: npt.ArrayLike,
        point: npt.ArrayLike | None,
    ) -> Array:
        """Return (6,): a force or impulse, and with its moment about the centre of mass a torque or angular impulse."""
        force = as_array(f"{linear_name} on {body.name}", linear, (3,))
        torque = as_array(f"{angular_name} on {body.name}", angular, (3,))
        if point is not None:
            arm = as_array(f"point on {body.name}", point, (3,)) - self._core.positions[body.index]
            torque += np.cross(arm, force)
        return np.concatenate((force, torque))

    def _inhabit(self, inhabitants: Inhabitants) -> None:
        """Take over what follows from the bodies; the core has them already."""
        raise NotImplementedError
