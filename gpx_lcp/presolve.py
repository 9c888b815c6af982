"""Presolve: the smallest model with the same answer.

`gpx.solve` and `World` solve smaller systems in the place of the one that was asked, wherever the answer is the same,
and lift the impulses back: what a user sees is of full size, and judged on the system as it was asked. The reductions:

============== ================================================================== =================================
reduction      recognised by                                                      what is left
============== ================================================================== =================================
islands        contacts that no chain of moving bodies joins                      systems of their own, on threads
free bodies    no contact                                                         nothing
resting        an island for which the impulses it starts from are a solution     nothing: they are kept
inactive       an island in which no contact closes; contacts out of reach        nothing: no impulse is the answer
redundant      without friction, a contact within the convex hull of others       nothing: the corners carry the load
frictionless   an island without friction                                         one row for a contact
duplicates     the same bodies, rows, B and friction                              one contact, shared equally
translational  pushes through the centres of mass, point masses                   three velocities for a body
planar         all motion in one plane, contacts balanced about it                two rows, three velocities
collinear      all motion along one line at each contact, contacts balanced       one row, one velocity
closed form    one contact; a chain of bodies on one line                         nothing: solved without iteration
============== ================================================================== =================================

The impulses of a solution have bounded energy: with c any change of velocity that opens all contacts, for example a
stop of all bodies, what they change lies in the ball with diameter c. Contact i opens there with at least
½ (Ĵ c)_n - B_n - ½ ‖Ĵ_n‖ ‖c‖; where that is positive it is out of reach and left out, and what it joined may fall
apart. Contacts of a pair of bodies on one plane that lie between others, and have no more to cancel than these have
there, are kept open by them; that holds without friction, and under the convex law where the coefficient is the same.
Contacts left out have no impulse.

From `frictionless` on all is one theorem, but for the closed form. Gather contacts i in groups g, with weights w_i > 0
that add up to one and frames C_i (orthonormal columns, the first the normal), and give every body b a subspace of its
velocities, whitened by M^½, with an orthonormal basis Q. Solve J' = Σ w_i C_iᵀ Ĵ_i Q, B' = Σ w_i C_iᵀ B_i, and lift
p_i = w_i C_i q_g. Where

* Σ w_i C_iᵀ Ĵ_i has no part outside the subspaces,
* Ĵ_i Q = C_i J'_g, and B_i = C_i B'_g,

u_i = Ĵ_i Ĵᵀ p - B_i = Ĵ_i Q J'ᵀ q - C_i B'_g = C_i u'_g: every contact of a group moves as the reduced one does. The
laws of contact are isotropic and homogeneous, so they hold for (p_i, u_i) exactly where they hold for (q_g, u'_g).
The core checks these three conditions to rounding before it uses a reduction; proofs of each are in
`gpx_lcp/rust/src/presolve`.

The frictionless and the convex law have one velocity, with or without presolve. Coulomb's law can have several exact
solutions, and then presolve may find another one. Contacts that share a load in more than one way share it equally,
or in the plane by the least weights without a moment out of it.

A world remembers islands that have a closed form, with their rows: where the next step has the same contacts, as on a
tower whose load changes, to the last bit of Ĵ, only B is looked at. That changes no result.

Of a system given by A alone islands, inactive contacts, rows without friction and single contacts are found; it has
no velocities to count. Not reduced: contacts with friction that others keep open by Coulomb's law, where the load moves
the friction with it; and the tangents of single contacts without friction in an island that has some.

`newton` and `interior_point` do this, each part to its share of the tolerance, and so does `pgs`, until all parts are
within that of the whole. A sweep costs little where there is little to do, so that `pgs` takes a system apart only for
a twentieth of its contacts or more, sweeps points and balls without friction as they are, does not look for contacts
out of reach, and sweeps islands that stay as they are as one, until most of them are done. The programs over polygons,
"box" and "pyramid", have axes of their own in the tangent plane, which reductions would turn: they are solved as they
are, but that `lemke` takes islands apart, small ones together.

Every other solver, be it `lemke`, `osqp` or `clarabel`, is given what is left of "normal" and "cone", each part to its
share of the tolerance. One whose time grows faster than the number of unknowns, as that of dense methods does, solves
the parts one by one (`apart` in its row of the table); any other those of one shape as one, as one more call costs it
more than a larger matrix. Their unknowns are impulses: where only velocities would be fewer, they take the system as it
is. Where nothing is left, or all that is left starts from a solution, they are not called, and a setting that only they
know goes unread.
"""

from __future__ import annotations

from formulations import StackedSystem
from gpx_lcp.core_system import core_system
from gpx_lcp.errors import ProblemError, SettingsError
from gpx_lcp.presolved import Presolve
from gpx_lcp.scene import Scene
from gpx_lcp.solve import default_formulation
from gpx_lcp.world import World

# The formulations whose laws are isotropic.
REDUCED = ("normal", "cone", "coulomb")


def presolve(what: StackedSystem | Scene, formulation: str | None = None, *, time_step: float = 1 / 240) -> Presolve:
    """Return what presolve would make of a system, or of the first step of a scene; nothing is solved.

    Parameters
    ----------
    what : StackedSystem or Scene
    formulation : "normal", "cone" or "coulomb", optional
        As in `gpx.solve`.
    time_step : float, s
        Of the scene's first step.

    Raises
    ------
    ProblemError
        When `what` is neither.
    SettingsError
        When there are no reductions for the formulation.
    """
    if isinstance(what, Scene):
        what = World(what, time_step, presolve=False).system()
    if not isinstance(what, StackedSystem):
        raise ProblemError(f"what is a {type(what).__name__}: a StackedSystem or a Scene is needed")
    if formulation is None:
        formulation = default_formulation(what, None)
    if formulation not in REDUCED:
        raise SettingsError(f"formulation is {formulation!r}: presolve knows {', '.join(map(repr, REDUCED))}")
    return Presolve.of(core_system(what).presolve(formulation))
