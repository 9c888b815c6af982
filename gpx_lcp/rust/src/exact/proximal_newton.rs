//! Proximal point method around a Newton method that sees the friction coupling.
//!
//! The outer iteration solves, for per-contact weights σ_i = σ/d_i,
//!
//!   p = P_K(p_k − σ_i û(p)),     û(p) = u + μ‖u_t‖ n,   u = A p − B,
//!
//! and takes its solution as p_{k+1}. With σ = ∞ this is the problem itself; a smaller σ keeps p near p_k, which makes the
//! equation regular where redundant contacts or the coupling make the problem singular: σ is the trust. The inner
//! iteration is a generalised Newton method, (I + σ P' T A) dp = −F with T = I + μ n t̂ᵀ, its steps halved until ‖F‖ falls.
//!
//! Source: R. T. Rockafellar, *Monotone operators and the proximal point algorithm*, SIAM J. Control Optim. 14 (1976); P.
//! Alart, A. Curnier, *A mixed formulation for frictional contact problems prone to Newton like solution methods*, Comput.
//! Methods Appl. Mech. Eng. 92 (1991); V. Acary, M. Brémond, O. Huber, INRIA RR-9118 (2018), section on PPA.
//! Measured on the problems of the tests and found worse: letting ‖F‖ climb for some steps (a third more Newton steps),
//! and taking P_K(p_k − σ û) instead of P_K(p) as the next centre (for large σ it carries the rounding of û, times σ).

use super::cones::project;
use super::newton_system::NewtonSystem;
use super::problem::{Best, Limits, Problem};
use super::small::{IDENTITY, Matrix, Vector, ZERO, dot, product};

/// The trust with which to start at rest, and near a solution.
pub const COLD_TRUST: f64 = 1.0;
pub const WARM_TRUST: f64 = 100.0;
const LARGEST_TRUST: f64 = 1e9;
const SMALLEST_TRUST: f64 = 1e-6;
/// An inner solve of at most so many Newton steps is easy: more trust. One of more than `HARD` steps: less.
const EASY: usize = 4;
const HARD: usize = 25;
/// A solved inner problem that raises the residual by more than that has been solved to rounding, not to anything better.
const NOISY: f64 = 30.0;
/// Rounding in û relative to the impulses that make it; F cannot be smaller than σ times that.
const NOISE: f64 = 1e-15;

/// How the method starts and when it gives up.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    pub trust: f64,
    /// Newton steps allowed in one inner solve.
    pub inner_steps: usize,
    /// Whether to stop at the first inner solve that takes more than that.
    pub only_while_easy: bool,
    /// Newton steps in which the best residual must halve.
    pub patience: usize,
}

/// Runs from `start`; returns the number of Newton steps. The best impulses go to `best`.
pub fn proximal_newton(
    problem: &Problem,
    system: &mut NewtonSystem,
    limits: &Limits,
    start: &[Vector],
    effort: Effort,
    best: &mut Best,
) -> usize {
    let mut sigma = effort.trust;
    // Where the method failed lately: trust returns there only step by step.
    let mut ceiling = f64::INFINITY;
    let mut steps = 0;
    let mut centre = start.to_vec();
    let mut trial = Trial::new(problem.contacts());
    let mut candidate = centre.clone();
    let mut residual = trial.natural_map(problem, &centre);
    best.offer(0, &centre, residual);
    let mut milestone = (0, best.residual);
    while best.residual > limits.tolerance && steps < limits.iterations && !limits.expired() {
        let size = (problem.contacts() as f64).sqrt();
        let aim = 0.1 * residual.min(1.0) * sigma.clamp(1e-3, 1.0) * size;
        let limit = effort.inner_steps.min(limits.iterations - steps);
        let inner = solve_inner(problem, system, &centre, sigma, aim, limit, &mut trial);
        steps += inner.steps;
        let mut unused = IDENTITY;
        for ((out, p), &mu) in candidate.iter_mut().zip(&trial.p).zip(&problem.friction) {
            *out = project(p, mu, &mut unused);
        }
        let reached = trial.natural_map(problem, &candidate);
        best.offer(steps, &candidate, reached);
        if best.residual < 0.5 * milestone.1 {
            milestone = (steps, best.residual);
        }
        let easy = inner.converged || !effort.only_while_easy;
        // No step at all, and nothing gained: rounding is all that is left at this trust and any larger one.
        let rounding = inner.steps == 0 && reached >= residual && sigma >= WARM_TRUST;
        if !easy || rounding || steps - milestone.0 > effort.patience {
            break;
        }
        if reached < residual || inner.converged && reached < NOISY * residual {
            centre.copy_from_slice(&candidate);
            residual = reached;
            if !inner.converged {
                sigma *= 0.5;
            } else if inner.steps <= EASY {
                sigma = (10.0 * sigma).min(ceiling).min(LARGEST_TRUST);
                ceiling *= 2.0;
            } else if inner.steps > HARD {
                sigma *= 0.7;
            }
        } else {
            ceiling = sigma / 4.0;
            sigma /= 8.0;
        }
        if sigma < SMALLEST_TRUST {
            break;
        }
    }
    steps
}

/// One step from these impulses, P_K(p_{k+1}), with this trust.
pub fn single_step(
    problem: &Problem,
    system: &mut NewtonSystem,
    centre: &[Vector],
    sigma: f64,
) -> Vec<Vector> {
    let mut trial = Trial::new(problem.contacts());
    solve_inner(problem, system, centre, sigma, 0.0, HARD, &mut trial);
    let mut unused = IDENTITY;
    let parts = trial.p.iter().zip(&problem.friction);
    parts.map(|(p, &mu)| project(p, mu, &mut unused)).collect()
}

struct Inner {
    converged: bool,
    steps: usize,
}

/// A point of the inner iteration with F = √d (p − P_K(p_k − σ_i û)) and what Newton needs of it.
struct Trial {
    p: Vec<Vector>,
    u: Vec<Vector>,
    miss: Vec<Vector>,
    blocks: Vec<Matrix>,
    /// ‖F‖.
    residual: f64,
    /// 1 + ‖√d p‖.
    size: f64,
    scratch: Vec<f64>,
}

impl Trial {
    fn new(contacts: usize) -> Self {
        Self {
            p: vec![ZERO; contacts],
            u: vec![ZERO; contacts],
            miss: vec![ZERO; contacts],
            blocks: vec![[ZERO; 3]; contacts],
            residual: 0.0,
            size: 1.0,
            scratch: Vec::new(),
        }
    }

    /// F and the blocks E = σ_i P' T at the present p.
    fn evaluate(&mut self, problem: &Problem, centre: &[Vector], sigma: f64) {
        problem.velocity(&self.p, &mut self.u, &mut self.scratch);
        let (mut sum, mut squares) = (0.0, 0.0);
        for i in 0..self.p.len() {
            let d = problem.weight[i];
            if d == 0.0 {
                continue;
            }
            let (u, mu, step) = (&self.u[i], problem.friction[i], sigma / d);
            let corrected = problem.corrected(i, u);
            let aim = [0, 1, 2].map(|k| centre[i][k] - step * corrected[k]);
            let mut derivative = IDENTITY;
            let image = project(&aim, mu, &mut derivative);
            if let Some(coupling) = problem.coupling(mu, u) {
                derivative = product(&derivative, &coupling);
            }
            self.blocks[i] = derivative.map(|line| line.map(|value| value * step));
            self.miss[i] = [0, 1, 2].map(|k| self.p[i][k] - image[k]);
            sum += d * dot(&self.miss[i], &self.miss[i]);
            squares += d * dot(&self.p[i], &self.p[i]);
        }
        self.residual = sum.sqrt();
        self.size = 1.0 + squares.sqrt();
    }

    /// The residual of the problem itself at p, which need not be the point of this trial.
    fn natural_map(&mut self, problem: &Problem, p: &[Vector]) -> f64 {
        problem.velocity(p, &mut self.u, &mut self.scratch);
        problem.natural_map(p, &self.u)
    }
}

/// Solves p = P_K(centre − σ_i û(p)) until ‖F‖ ≤ aim or is rounding; `trial.p` is the solution.
fn solve_inner(
    problem: &Problem,
    system: &mut NewtonSystem,
    centre: &[Vector],
    sigma: f64,
    aim: f64,
    limit: usize,
    trial: &mut Trial,
) -> Inner {
    const SHORTEST: f64 = 1e-2;
    let contacts = problem.contacts();
    trial.p.copy_from_slice(centre);
    trial.evaluate(problem, centre, sigma);
    let mut steps = 0;
    let mut dp = vec![ZERO; contacts];
    let mut next = Trial::new(contacts);
    while trial.residual > aim.max(NOISE * sigma * trial.size) {
        if steps == limit {
            return Inner {
                converged: false,
                steps,
            };
        }
        system.factor(&trial.blocks, &problem.weight);
        let right: Vec<Vector> = trial
            .miss
            .iter()
            .map(|miss| miss.map(|value| -value))
            .collect();
        system.solve(&right, &mut dp);
        steps += 1;
        let mut length = 1.0;
        loop {
            for ((out, p), d) in next.p.iter_mut().zip(&trial.p).zip(&dp) {
                *out = [0, 1, 2].map(|k| p[k] + length * d[k]);
            }
            next.evaluate(problem, centre, sigma);
            if next.residual < (1.0 - 0.1 * length) * trial.residual {
                break;
            }
            length *= 0.5;
            if length < SHORTEST {
                return Inner {
                    converged: false,
                    steps,
                };
            }
        }
        std::mem::swap(trial, &mut next);
    }
    Inner {
        converged: true,
        steps,
    }
}
