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
//!
//! Impulses p that nearly open all contacts rule such a y out beforehand. Where y is frictionless, of entries up to one, and
//! A symmetric, −Σ max(−u_n, 0) ≤ yᵀ u = (A y)ᵀ p − Bᵀ y ≤ (‖p‖ ‖A y‖/Bᵀ y − 1) Bᵀ y: what `proves` asks of A y and Bᵀ y
//! leaves contacts that close by some 10⁻⁶ ‖B‖ at least.

use super::cones::project;
use super::newton_system::{NewtonSystem, Operator};
use super::problem::Problem;
use super::proximal_newton::single_step;
use super::small::{IDENTITY, Vector, ZERO, dot, largest, norm};

const TRUST: f64 = 1e8;
/// Impulses up to that size, where velocities are of size one, are ruled out by an accepted proof: a weight of 10⁷ on a
/// tower of ten asks for 10⁸.
const REACH: f64 = 1e11;
/// Bᵀ y of an accepted proof, as a share of ‖B‖.
const GAIN: f64 = 1e-6;
/// Steps before the one that is read: each takes what A moves down by its response times the trust.
const STEPS: usize = 4;

/// Looks for y, up to a factor; the law of `problem` must not be Coulomb's.
pub fn certificate(problem: &Problem) -> Option<Vec<Vector>> {
    between_locked_bodies(problem)
        .or_else(|| far_steps(problem))
        .filter(|ray| proves(problem, ray))
}

/// Whether no proof for the problem without its coupling is accepted, as these impulses p, which lead to u, show.
pub fn is_ruled_out(problem: &Problem, p: &[Vector], u: &[Vector]) -> bool {
    let frictionless = problem.coupled || problem.friction.iter().all(|&mu| mu == 0.0);
    let closing: f64 = u.iter().map(|u| (-u[0]).max(0.0)).sum();
    // One that is no number rules nothing out.
    frictionless
        && matches!(problem.operator, Operator::Velocity(_))
        && norm(p) <= 0.1 * REACH
        && closing <= 0.9 * GAIN * problem.b_norm()
        && u.iter().all(|u| u[0].is_finite())
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
    let size = largest(ray.as_flattened());
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
    gain > REACH * norm(&moved) && gain > GAIN * problem.b_norm()
}

#[cfg(test)]
mod tests {
    use super::super::block_matrix::BlockMatrix;
    use super::super::problem::Law;
    use super::*;

    /// A body of 1 kg between a wall on its left and one on its right, which close or open by so much.
    fn between_walls(left: f64, right: f64) -> Problem {
        let factor = BlockMatrix::new(vec![0, 1, 2], vec![0, 0], vec![1.0, -1.0], (1, 1), 1);
        let operator = Operator::Velocity(factor.expect("two blocks"));
        Problem::new(operator, &[left, right], &[0.0; 2], Law::Normal).expect("two contacts")
    }

    fn is_ruled_out_by(problem: &Problem, p: [f64; 2]) -> bool {
        let p = p.map(|normal| [normal, 0.0, 0.0]);
        let mut u = vec![ZERO; 2];
        problem.velocity(&p, &mut u, &mut Vec::new());
        is_ruled_out(problem, &p, &u)
    }

    #[test]
    fn impulses_that_open_all_contacts_rule_a_proof_out() {
        let problem = between_walls(1.0, -2.0);
        assert!(certificate(&problem).is_none());
        assert!(!is_ruled_out_by(&problem, [0.0, 0.0]));
        assert!(is_ruled_out_by(&problem, [problem.b[0][0], 0.0]));
        // So large that what they leave of u is rounding.
        assert!(!is_ruled_out_by(&problem, [1e12, 1e12]));
        assert!(!is_ruled_out_by(&problem, [f64::NAN, 0.0]));
    }

    #[test]
    fn no_impulses_rule_a_proof_out_that_there_is() {
        // The walls close by a share of what B is.
        for share in [1.0, 1e-2, 1e-4] {
            let problem = between_walls(1.0, share - 1.0);
            assert!(certificate(&problem).is_some());
            for k in -400..=400 {
                let push = f64::from(k) / 100.0;
                assert!(!is_ruled_out_by(
                    &problem,
                    [push.max(0.0), (-push).max(0.0)]
                ));
            }
        }
    }
}
