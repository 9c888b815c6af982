"""Newton's law of restitution, the founding paper's: elasticity × closing velocity, contact by contact, all at once.

    B_n = -e u_n⁻,        B_t = -e_t u_t⁻,        K ∋ p ⟂ û ∈ K*,  û from u = A p - B,

that is A F dt = B with the paper's B = Σ e_i v_i in each contact's frame. A contact that bears an impulse leaves with
u_n⁺ = -(e - 1) u_n⁻, one that does not leaves faster; friction drives u_t⁺ to -(e_t - 1) u_t⁻ as far as Coulomb's bound
lets it. One exact Coulomb problem (one LCP where there is no friction).

Without friction the energy changes by ½ Σ p_i (u_i⁺ + u_i⁻). A contact that bears an impulse and closes with u_i⁻ < 0
adds ½ p_i (2 - e_i) u_i⁻ ≤ 0; one that separated beforehand adds ½ p_i u_i⁻ > 0, and the sum may be a gain.

Source: M. Policht, *General formula for collision impulse of two material objects in translational motion*, eqs. 1.3
to 1.5, stacked; J. J. Moreau, *Unilateral contact and dry friction in finite freedom dynamics* (1988).
"""

from __future__ import annotations

from gpx_lcp.impact_laws._interface import Collision, ImpactLaw, Impulses


def run(collision: Collision) -> Impulses:
    """Solve the stacked law."""
    before = collision.before
    restitution = collision.acting(-before[:, 0])
    B = -before - restitution[:, [0] + [1] * (collision.rows - 1)] * before
    solution = collision.solve(B)
    return Impulses(solution.impulse, (solution,))


LAW = ImpactLaw(
    name="newton",
    summary="closing velocity × elasticity, contact by contact, one program",
    promises="Each contact that bears an impulse leaves with (e - 1) times the speed at which it closed. Without "
    "friction, and where no contact separates beforehand, no energy is gained.",
    breaks="Friction can make it gain energy (Kane's double pendulum), and ask for what no impulses give (linkages). A "
    "row of equal balls is no cradle: the first comes back with (n - 2)/n.",
    run=run,
    in_core=True,
)
