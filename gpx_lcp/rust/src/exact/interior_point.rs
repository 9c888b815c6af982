//! Primal-dual interior point on the friction cones, with the friction coupling inside the Newton step.
//!
//! In Lorentz coordinates r = S⁻¹ p, û = S u with S = s diag(1/μ, 1, 1), the problem is
//!
//!   r ∈ Q,  z ∈ Q,  r ∘ z = 0,   z = y(u) = u + (‖u_t‖_ε − ε) e,   u = A r − B,    ‖u_t‖_ε = √(‖u_t‖² + ε²),
//!
//! (without the middle term for the convex laws). Each step linearises r ∘ z = σ τ e in Nesterov-Todd scaled form,
//! W dz + W⁻¹ dr = c, and z = y(u) with T = y'(u) = I + e t̂ᵀ, where t̂ = u_t/‖u_t‖_ε: both together are
//!
//!   (I + E A) dr = W (c + W ρ),   E = W² T,   ρ = z − y(u),   dz = T A dr − ρ,
//!
//! a small nonsymmetric term more than the convex case. ε falls with τ. A predictor step (σ = 0) chooses σ and gives the
//! second-order correction.
//!
//! Source: S. Mehrotra, *On the implementation of a primal-dual interior point method*, SIAM J. Optim. 2 (1992), for
//! predictor and corrector; V. Acary, P. Armand, H. M. Nguyen, M. Shpakovych, *Second-order cone programming for
//! frictional contact mechanics using interior point algorithm*, Optim. Methods Softw. 39 (2024), for the convex case.
//! Departures: (1) the coupling is linearised with the rest instead of being frozen; (2) σ is kept large enough that τ does
//! not run ahead of the residual ρ of z = y(u), because the central path of Coulomb's law is found only near ρ = 0; (3)
//! where that path folds, it is followed by its length: see `fold`.

mod fold;

use super::cones::{Scaling, jordan, jordan_divide, step_to_boundary};
use super::infeasibility::is_ruled_out;
use super::newton_system::NewtonSystem;
use super::problem::{Best, Limits, Problem};
use super::small::{IDENTITY, Matrix, Vector, ZERO, dot, product, tangent_norm, times};
use fold::Fold;

/// Steps off the path, one after another, in which the residual must fall by a tenth, or τ by three tenths, or the
/// iteration is called stalled.
const PATIENCE: usize = 6;
/// The same for all steps: along the path it is a long way from one fold to the next.
const LONG_PATIENCE: usize = 60;

/// The share of the way to the boundary of the cones that a step may go. Where folds are to be followed, it is nine tenths,
/// and this only where the predictor does well: the path is lost where some contacts are far from its middle.
const DAMPING: f64 = 0.99;

/// How the method starts, and how strongly it smooths ‖u_t‖.
#[derive(Debug, Clone, Copy)]
pub struct Start {
    /// The expected size of the impulses where velocities are of size one: r starts at that multiple of e, z at e.
    pub impulse_size: f64,
    /// ε/τ where the path does not ask for more.
    pub smoothing: f64,
}

/// The size of impulses p, the root mean square of √d p, where velocities are of size one.
pub fn impulse_size(problem: &Problem, p: &[Vector]) -> f64 {
    let squares = p.iter().zip(&problem.weight).map(|(p, d)| d * dot(p, p));
    (squares.sum::<f64>() / problem.contacts().max(1) as f64).sqrt()
}

/// Impulses that stop every contact, (A + d/100) p = B: not a solution, but in stacks of its size.
pub fn stopping_impulses(problem: &Problem, system: &mut NewtonSystem) -> Vec<Vector> {
    const TRUST: f64 = 100.0;
    let active = |i: usize, k: usize| k == 0 || problem.friction[i] > 0.0;
    let blocks: Vec<Matrix> = (0..problem.contacts())
        .map(|i| {
            let mut block = [ZERO; 3];
            for (k, line) in block.iter_mut().enumerate() {
                if problem.weight[i] > 0.0 && active(i, k) {
                    line[k] = TRUST / problem.weight[i];
                }
            }
            block
        })
        .collect();
    system.factor(&blocks, &problem.weight);
    let right: Vec<Vector> = blocks
        .iter()
        .zip(&problem.b)
        .map(|(e, b)| times(e, b))
        .collect();
    let mut impulses = vec![ZERO; right.len()];
    system.solve(&right, &mut impulses);
    impulses
}

/// Runs from the middle of the cones; returns the number of Newton steps. The best impulses go to `best`.
pub fn interior_point(
    problem: &Problem,
    system: &mut NewtonSystem,
    limits: &Limits,
    start: Start,
    best: &mut Best,
) -> usize {
    let mut point = Point::new(problem, start);
    let (mut reference, mut idle, mut lost) = ((f64::INFINITY, f64::INFINITY), 0, 0);
    let mut step = 0;
    loop {
        best.is_feasible |= point.update(problem);
        best.offer(step, &point.impulse, point.residual);
        if point.residual < 0.9 * reference.0 || point.tau < 0.7 * reference.1 {
            reference = (point.residual.min(reference.0), point.tau.min(reference.1));
            (idle, lost) = (0, 0);
        } else {
            idle += 1;
            lost = if point.fold.as_ref().is_some_and(Fold::on_path) {
                0
            } else {
                lost + 1
            };
        }
        let finished = best.residual <= limits.tolerance || step == limits.iterations;
        if finished
            || lost > PATIENCE
            || idle > LONG_PATIENCE
            || limits.expired()
            || !point.is_interior()
        {
            return step;
        }
        if !point.advance(problem, system) {
            return step + 1;
        }
        step += 1;
    }
}

/// The iterate and everything that is recomputed at each step.
struct Point {
    r: Vec<Vector>,
    z: Vec<Vector>,
    /// S, contact by contact: the normal's factor and the tangents'; zero where the contact has no such row.
    s: Vec<Vector>,
    impulse: Vec<Vector>,
    /// Scaled velocities S u.
    u: Vec<Vector>,
    tau: f64,
    /// ε/τ.
    smoothing: f64,
    least_smoothing: f64,
    /// ρ = z − y(u).
    rho: Vec<Vector>,
    coupling: Vec<Matrix>,
    scaling: Vec<Scaling>,
    residual: f64,
    scratch: Vec<f64>,
    /// Contacts that take part.
    cones: f64,
    /// The length of the last step.
    length: f64,
    fold: Option<Fold>,
}

struct Direction {
    dr: Vec<Vector>,
    dz: Vec<Vector>,
}

impl Direction {
    /// Adds a multiple of another direction.
    fn add(&mut self, factor: f64, other: &Self) {
        for (field, more) in [(&mut self.dr, &other.dr), (&mut self.dz, &other.dz)] {
            for (value, d) in field.iter_mut().flatten().zip(more.iter().flatten()) {
                *value += factor * d;
            }
        }
    }
}

impl Point {
    fn new(problem: &Problem, start: Start) -> Self {
        let contacts = problem.contacts();
        let s: Vec<Vector> = (0..contacts)
            .map(|i| {
                let (d, mu) = (&problem.diagonal[i], problem.friction[i]);
                if problem.weight[i] == 0.0 {
                    ZERO
                } else if mu == 0.0 {
                    [1.0 / d[0].max(1e-8 * problem.weight[i]).sqrt(), 0.0, 0.0]
                } else {
                    let size = (d[0] / (mu * mu)).max(d[1]).max(d[2]).sqrt();
                    [1.0 / (mu * size), 1.0 / size, 1.0 / size]
                }
            })
            .collect();
        Self {
            r: vec![[start.impulse_size, 0.0, 0.0]; contacts],
            z: vec![[1.0, 0.0, 0.0]; contacts],
            cones: s.iter().filter(|s| s[0] > 0.0).count() as f64,
            s,
            impulse: vec![ZERO; contacts],
            u: vec![ZERO; contacts],
            tau: start.impulse_size,
            smoothing: start.smoothing,
            least_smoothing: start.smoothing,
            rho: vec![ZERO; contacts],
            coupling: vec![IDENTITY; contacts],
            scaling: Vec::with_capacity(contacts),
            residual: f64::INFINITY,
            scratch: Vec::new(),
            length: 1.0,
            fold: problem.coupled.then(Fold::new),
        }
    }

    /// Velocities, residuals and the coupling T at the present r and z; returns whether they rule out infeasibility.
    fn update(&mut self, problem: &Problem) -> bool {
        for ((p, r), s) in self.impulse.iter_mut().zip(&self.r).zip(&self.s) {
            *p = [r[0] * s[0], r[1] * s[1], r[2] * s[2]];
        }
        problem.velocity(&self.impulse, &mut self.u, &mut self.scratch);
        self.residual = problem.natural_map(&self.impulse, &self.u);
        let is_feasible = is_ruled_out(problem, &self.impulse, &self.u);
        let products: f64 = self
            .r
            .iter()
            .zip(&self.z)
            .zip(&self.s)
            .filter(|(_, s)| s[0] > 0.0)
            .map(|((r, z), _)| dot(r, z))
            .sum();
        self.tau = products / self.cones;
        let epsilon = self.smoothing * self.tau;
        for (i, u) in self.u.iter_mut().enumerate() {
            let s = &self.s[i];
            *u = [u[0] * s[0], u[1] * s[1], u[2] * s[2]];
            let mut y = *u;
            if problem.coupled && problem.friction[i] > 0.0 {
                let smooth = (u[1] * u[1] + u[2] * u[2] + epsilon * epsilon).sqrt();
                y[0] += smooth - epsilon;
                self.coupling[i][0] = [1.0, u[1] / smooth, u[2] / smooth];
            }
            let z = &self.z[i];
            self.rho[i] = if s[0] > 0.0 {
                [z[0] - y[0], z[1] - y[1], z[2] - y[2]]
            } else {
                ZERO
            };
        }
        is_feasible
    }

    /// Whether r and z are strictly inside their cones, by more than rounding.
    fn is_interior(&self) -> bool {
        let inside = |x: &Vector| x[0] - tangent_norm(x) > 0.0 && x[0].is_finite();
        self.r
            .iter()
            .zip(&self.z)
            .all(|(r, z)| inside(r) && inside(z))
    }

    /// One predictor-corrector step; false when no step of useful length is left.
    fn advance(&mut self, problem: &Problem, system: &mut NewtonSystem) -> bool {
        self.scaling.clear();
        self.scaling
            .extend(self.r.iter().zip(&self.z).map(|(r, z)| Scaling::new(r, z)));
        let blocks: Vec<Matrix> = (0..self.r.len()).map(|i| self.newton_block(i)).collect();
        system.factor(&blocks, &problem.weight);
        let lambda: Vec<Vector> = self
            .scaling
            .iter()
            .zip(&self.z)
            .map(|(scaling, z)| times(&scaling.w, z))
            .collect();

        let affine: Vec<Vector> = lambda.iter().map(|l| l.map(|value| -value)).collect();
        let predictor = self.direction(system, &affine);
        let reach = self.step_length(&predictor).min(1.0);
        let mut damping = DAMPING;
        if let Some(mut fold) = self.fold.take() {
            let sign = system.determinant_sign();
            let ahead = fold.ahead(self.length, reach, sign);
            if ahead {
                let go_on = self.follow(system, &lambda, predictor, sign, &mut fold);
                self.fold = Some(fold);
                return go_on;
            }
            self.fold = Some(fold);
            damping = 0.9 + 0.09 * reach;
            self.sharpen();
        }
        let sigma = self.centring(reach);

        let second_order: Vec<Vector> = (0..lambda.len())
            .map(|i| {
                let (scaling, l) = (&self.scaling[i], &lambda[i]);
                let square = jordan(l, l);
                let cross = jordan(
                    &times(&scaling.inverse, &predictor.dr[i]),
                    &times(&scaling.w, &predictor.dz[i]),
                );
                let aim = [
                    sigma * self.tau - square[0] - cross[0],
                    -square[1] - cross[1],
                    -square[2] - cross[2],
                ];
                jordan_divide(l, &aim)
            })
            .collect();
        let mut direction = self.direction(system, &second_order);
        let mut length = (damping * self.step_length(&direction)).min(1.0);
        if length < 0.1 {
            // The correction misleads far from the path: a plain, well-centred Newton step instead.
            let centred: Vec<Vector> = lambda
                .iter()
                .map(|l| {
                    let square = jordan(l, l);
                    jordan_divide(
                        l,
                        &[
                            sigma.max(0.5) * self.tau - square[0],
                            -square[1],
                            -square[2],
                        ],
                    )
                })
                .collect();
            let plain = self.direction(system, &centred);
            let other = (damping * self.step_length(&plain)).min(1.0);
            if other > length {
                (direction, length) = (plain, other);
            }
        }
        if length.is_nan() || length < 1e-10 {
            return false;
        }
        self.go(&direction, length);
        true
    }

    fn go(&mut self, direction: &Direction, length: f64) {
        for (field, change) in [(&mut self.r, &direction.dr), (&mut self.z, &direction.dz)] {
            for (value, d) in field.iter_mut().flatten().zip(change.iter().flatten()) {
                *value += length * d;
            }
        }
        self.length = length;
    }

    /// E = S W² T S of one contact, in the coordinates of p.
    fn newton_block(&self, i: usize) -> Matrix {
        let (w, s) = (&self.scaling[i].w, &self.s[i]);
        let mut block = product(&product(w, w), &self.coupling[i]);
        for (k, line) in block.iter_mut().enumerate() {
            for (l, value) in line.iter_mut().enumerate() {
                *value *= s[k] * s[l];
            }
        }
        block
    }

    /// Solves for (dr, dz) with W dz + W⁻¹ dr = c.
    fn direction(&mut self, system: &mut NewtonSystem, c: &[Vector]) -> Direction {
        let contacts = c.len();
        let g: Vec<Vector> = (0..contacts)
            .map(|i| {
                let (w, s) = (&self.scaling[i].w, &self.s[i]);
                let shift = times(w, &self.rho[i]);
                let inner = times(
                    w,
                    &[c[i][0] + shift[0], c[i][1] + shift[1], c[i][2] + shift[2]],
                );
                [inner[0] * s[0], inner[1] * s[1], inner[2] * s[2]]
            })
            .collect();
        let mut dr = vec![ZERO; contacts];
        let mut dz = system.solve_with_image(&g, &mut dr).to_vec();
        for i in 0..contacts {
            let s = &self.s[i];
            let du = times(
                &self.coupling[i],
                &[dz[i][0] * s[0], dz[i][1] * s[1], dz[i][2] * s[2]],
            );
            for k in 0..3 {
                dz[i][k] = du[k] - self.rho[i][k];
                dr[i][k] = if s[k] > 0.0 { dr[i][k] / s[k] } else { 0.0 };
            }
        }
        Direction { dr, dz }
    }

    fn step_length(&self, direction: &Direction) -> f64 {
        let r = self.r.iter().zip(&direction.dr);
        let z = self.z.iter().zip(&direction.dz);
        r.chain(z)
            .map(|(x, d)| step_to_boundary(x, d))
            .fold(f64::INFINITY, f64::min)
    }

    /// σ: small when the predictor got far, but not so small that τ runs ahead of ‖ρ‖.
    fn centring(&self, reach: f64) -> f64 {
        let rho = (self.rho.iter().map(|rho| dot(rho, rho)).sum::<f64>() / self.cones).sqrt();
        let floor = 0.1 * (1.0 - reach) * rho / self.tau;
        (1.0 - reach).powi(3).max(floor.min(2.0)).max(1e-4)
    }
}
