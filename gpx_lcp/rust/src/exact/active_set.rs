//! A semismooth Newton method on the natural map itself, for problems whose contact states are nearly known.
//!
//! With s = p − û/d the map is F(p) = p − P_K(s), and its generalised Newton equation (I − P' + P' T A/d) dp = −F, P' the
//! derivative of the projection at s. Redundant contacts make that singular; with (1 − ε) P' in the place of the first P'
//! it is not, and it reads
//!
//! ```text
//! (I + E A) dp = −N F,      N = (I − (1 − ε) P')⁻¹,   E = N P' T / d,
//! ```
//!
//! that is: an open contact gives up its impulse; a sticking one gets what stops it, at the price ε ‖dp‖² where impulses
//! are not unique; a sliding one moves along the generator of the cone. Where the states are right, one step leaves an
//! error of the order ε. It is the method for the next step of a stack, and for a stack at rest even from nothing; it
//! has no safeguard, so it gives up as soon as it does not get anywhere.
//!
//! Source: M. Hintermüller, K. Ito, K. Kunisch, *The primal-dual active set strategy as a semismooth Newton method*, SIAM
//! J. Optim. 13 (2002); S. Hüeber, G. Stadler, B. Wohlmuth, *A primal-dual active set algorithm for three-dimensional
//! contact problems with Coulomb friction*, SIAM J. Sci. Comput. 30 (2008).

use super::cones::project;
use super::newton_system::NewtonSystem;
use super::problem::{Best, Limits, Problem};
use super::small::{IDENTITY, Matrix, Vector, ZERO, dot, product, tangent_norm};

/// ε: the smaller, the closer one step gets, and the more of its digits are rounding.
const REGULARISATION: f64 = 1e-7;
/// Steps in which the best residual must halve.
const PATIENCE: usize = 3;
/// Steps beyond the tolerance, as long as they need no factorisation: a warm start then holds for the more time steps.
const POLISH: usize = 1;

/// Runs from `start`; returns the number of Newton steps. The best impulses go to `best`.
pub fn active_set(
    problem: &Problem,
    system: &mut NewtonSystem,
    limits: &Limits,
    start: &[Vector],
    best: &mut Best,
) -> usize {
    let contacts = problem.contacts();
    let mut p = start.to_vec();
    let mut u = vec![ZERO; contacts];
    let mut candidate = p.clone();
    let mut right = vec![ZERO; contacts];
    let mut dp = vec![ZERO; contacts];
    let mut blocks = vec![[ZERO; 3]; contacts];
    let mut scratch = Vec::new();
    problem.velocity(&p, &mut u, &mut scratch);
    best.offer(0, &p, problem.natural_map(&p, &u));
    let (mut steps, mut milestone) = (0, (0, best.residual));
    let mut polished = 0;
    while polished < POLISH && steps < limits.iterations && !limits.expired() {
        for i in 0..contacts {
            (blocks[i], right[i]) = linearised(problem, i, &p[i], &u[i]);
        }
        if best.residual <= limits.tolerance {
            if !system.is_factored(&blocks) {
                break;
            }
            polished += 1;
        }
        system.factor(&blocks, &problem.weight);
        system.solve(&right, &mut dp);
        steps += 1;
        let mut unused = IDENTITY;
        let mut inside = true;
        for i in 0..contacts {
            p[i] = [0, 1, 2].map(|k| p[i][k] + dp[i][k]);
            candidate[i] = project(&p[i], problem.friction[i], &mut unused);
            inside &= candidate[i] == p[i];
        }
        problem.velocity(&candidate, &mut u, &mut scratch);
        best.offer(steps, &candidate, problem.natural_map(&candidate, &u));
        if best.residual < 0.5 * milestone.1 {
            milestone = (steps, best.residual);
        } else if polished > 0 {
            break;
        }
        if steps - milestone.0 >= PATIENCE {
            break;
        }
        if !inside {
            problem.velocity(&p, &mut u, &mut scratch);
        }
    }
    steps
}

/// E and −N F of one contact.
fn linearised(problem: &Problem, i: usize, p: &Vector, u: &Vector) -> (Matrix, Vector) {
    let (d, mu) = (problem.weight[i], problem.friction[i]);
    if d == 0.0 {
        return ([ZERO; 3], ZERO);
    }
    let gain = 1.0 / (REGULARISATION * d);
    let open = ([ZERO; 3], p.map(|value| -value));
    let corrected = problem.corrected(i, u);
    let aim = [0, 1, 2].map(|k| p[k] - corrected[k] / d);
    if mu == 0.0 {
        if aim[0] < 0.0 {
            return open;
        }
        let mut block = [ZERO; 3];
        block[0][0] = gain;
        return (block, [-gain * u[0], -p[1], -p[2]]);
    }
    let tangent = tangent_norm(&aim);
    if tangent <= mu * aim[0] {
        // Sticking is u = 0, coupled or not.
        let block = IDENTITY.map(|line| line.map(|value| gain * value));
        return (block, u.map(|value| -gain * value));
    }
    if mu * tangent < -aim[0] {
        return open;
    }
    let length = (1.0 + mu * mu).sqrt();
    let towards = [aim[1] / tangent, aim[2] / tangent];
    let along = [
        1.0 / length,
        mu * towards[0] / length,
        mu * towards[1] / length,
    ];
    let outward = [-mu / length, towards[0] / length, towards[1] / length];
    let across = [0.0, -towards[1], towards[0]];
    let turn = mu * dot(&along, &aim) / length / tangent;
    let turning = 1.0 / (1.0 - (1.0 - REGULARISATION) * turn);
    let mut block = [ZERO; 3];
    for r in 0..3 {
        for c in 0..3 {
            block[r][c] = gain * along[r] * along[c] + turning * turn / d * across[r] * across[c];
        }
    }
    if let Some(coupling) = problem.coupling(mu, u) {
        block = product(&block, &coupling);
    }
    let (g, h, t) = (
        gain * dot(&along, &corrected),
        dot(&outward, p),
        turning * dot(&across, p),
    );
    let right = [0, 1, 2].map(|k| -(g * along[k] + h * outward[k] + t * across[k]));
    (block, right)
}
