//! Proof that a problem has no solution, where its contacts are driven into each other.
//!
//! An impulse y ≠ 0 of the cone that moves nothing, A y = 0, with Bᵀ y > 0 proves that no impulses p give velocities
//! u = A p − B in K*: they would need 0 ≤ yᵀ u = (A y)ᵀ p − Bᵀ y = −Bᵀ y. Under the convex law y may be any impulse of
//! the cone; under Coulomb's, whose û has more normal velocity than u, y must be frictionless, and then 0 ≤ yᵀ u is
//! what u_n ≥ 0 alone demands.
//!
//! Such y is where the proximal point method goes on an infeasible convex problem: its steps p_{k+1} − p_k tend to a
//! multiple of it (R. E. Bruck, S. Reich, *Nonexpansive projections and resolvents of accretive operators in Banach
//! spaces*, Houston J. Math. 3 (1977)). With a large trust a few steps are there, to rounding. A solution that is merely
//! large, because a heavy body rests on light ones, makes the steps vanish instead.

use super::cones::project;
use super::newton_system::NewtonSystem;
use super::problem::Problem;
use super::proximal_newton::single_step;
use super::small::{IDENTITY, Vector, ZERO, dot, norm};

const TRUST: f64 = 1e8;
/// Impulses up to that size, where velocities are of size one, are ruled out by an accepted proof: a weight of 10⁷ on a
/// tower of ten asks for 10⁸.
const REACH: f64 = 1e11;
/// Steps before the one that is read: each takes what A moves down by its response times the trust.
const STEPS: usize = 4;

/// Looks for y, up to a factor; the law of `problem` must not be Coulomb's.
pub fn certificate(problem: &Problem) -> Option<Vec<Vector>> {
    between_locked_bodies(problem)
        .or_else(|| far_steps(problem))
        .filter(|ray| proves(problem, ray))
}

/// The normal impulse of a contact that moves nothing and yet closes.
fn between_locked_bodies(problem: &Problem) -> Option<Vec<Vector>> {
    let closing = |i: &usize| problem.weight[*i] == 0.0 && problem.b[*i][0] > 0.0;
    let contact = (0..problem.contacts()).find(closing)?;
    let mut ray = vec![ZERO; problem.contacts()];
    ray[contact][0] = 1.0;
    Some(ray)
}

/// Where the steps of the proximal point method tend to.
fn far_steps(problem: &Problem) -> Option<Vec<Vector>> {
    let mut system = NewtonSystem::new(&problem.operator);
    let mut before = vec![ZERO; problem.contacts()];
    let mut after = before.clone();
    for _ in 0..STEPS {
        before = after;
        after = single_step(problem, &mut system, &before, TRUST);
    }
    let mut unused = IDENTITY;
    let mut ray: Vec<Vector> = after
        .iter()
        .zip(&before)
        .zip(&problem.friction)
        .map(|((p, q), &mu)| project(&std::array::from_fn(|r| p[r] - q[r]), mu, &mut unused))
        .collect();
    let size = ray
        .iter()
        .flatten()
        .fold(0.0_f64, |most, value| most.max(value.abs()));
    if size == 0.0 || !size.is_finite() {
        return None;
    }
    ray.iter_mut().flatten().for_each(|value| *value /= size);
    Some(ray)
}

fn proves(problem: &Problem, ray: &[Vector]) -> bool {
    let mut moved = vec![[0.0; 3]; ray.len()];
    problem.operator.apply(ray, &mut moved, &mut Vec::new());
    let gain: f64 = ray.iter().zip(&problem.b).map(|(y, b)| dot(y, b)).sum();
    gain > REACH * norm(&moved) && gain > 1e-6 * problem.b_norm()
}
