//! The contact problem as the exact solvers see it: without units, in an order of its own, with its residual.
//!
//! A is divided by the mean of d_i = max diag(A_ii), and B by its root mean square over contacts, so that velocities and
//! impulses are of size one and no constant in this folder has a unit. The residual is the scale-free natural map of the
//! certificate, ‖d (p − P_K(p − û/d))‖ / ‖B‖, which the normalisation does not change. Under Coulomb's law, which may have
//! several solutions, contacts are put in the order of `order`, which does not depend on the order they come in.

use std::time::{Duration, Instant};

use super::block_matrix::ShapeError;
use super::cones::project;
use super::newton_system::Operator;
use super::small::{IDENTITY, Matrix, Vector, ZERO, dot, largest, norm, tangent_norm};

/// The law that the impulses obey.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Law {
    /// 0 ≤ p_n ⟂ u_n ≥ 0, p_t = 0.
    Normal,
    /// K ∋ p ⟂ u ∈ K*, the convex relaxation.
    Cone,
    /// K ∋ p ⟂ u + μ‖u_t‖ n ∈ K*, Coulomb's law.
    Coulomb,
}

#[derive(Clone)]
pub struct Problem {
    pub operator: Operator,
    pub b: Vec<Vector>,
    /// μ of each contact under its law; 0 makes the contact a half-line.
    pub friction: Vec<f64>,
    /// Whether the friction coupling μ‖u_t‖ n is part of the law.
    pub coupled: bool,
    /// d_i; a contact with d_i = 0 moves nothing, and its residual is what its own û leaves.
    pub weight: Vec<f64>,
    pub diagonal: Vec<Vector>,
    /// Where contact i comes from; None where the caller's order is kept.
    order: Option<Vec<u32>>,
    impulse_unit: f64,
    b_norm: f64,
}

/// When to stop.
#[derive(Clone, Copy)]
pub struct Limits<'a> {
    pub tolerance: f64,
    pub iterations: usize,
    deadline: Option<Instant>,
    /// Asked before every Newton step.
    interrupted: &'a (dyn Fn() -> bool + Sync),
}

impl<'a> Limits<'a> {
    pub fn new(
        tolerance: f64,
        iterations: usize,
        seconds: Option<f64>,
        interrupted: &'a (dyn Fn() -> bool + Sync),
    ) -> Self {
        // Longer than a Duration can be is no limit.
        let limit = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        Self {
            tolerance,
            iterations,
            deadline: limit.and_then(|limit| Instant::now().checked_add(limit)),
            interrupted,
        }
    }

    /// What is left after so many Newton steps.
    pub fn after(&self, steps: usize) -> Self {
        Self {
            iterations: self.iterations.saturating_sub(steps),
            ..*self
        }
    }

    /// The time that is left, or None where there is no limit.
    pub fn left(&self) -> Option<Duration> {
        self.deadline
            .map(|deadline| deadline.saturating_duration_since(Instant::now()))
    }

    /// Whether time is up, or the caller wants to stop.
    pub fn expired(&self) -> bool {
        self.deadline
            .is_some_and(|deadline| Instant::now() >= deadline)
            || (self.interrupted)()
    }

    pub fn interrupted(&self) -> bool {
        (self.interrupted)()
    }
}

impl Problem {
    /// Takes the operator, B (rows per contact) and μ, checks their sizes, and removes the units.
    pub fn new(
        mut operator: Operator,
        b: &[f64],
        friction: &[f64],
        law: Law,
    ) -> Result<Self, ShapeError> {
        let (contacts, rows) = (operator.contacts(), operator.rows());
        if b.len() != contacts * rows {
            return Err(ShapeError::Length {
                name: "B",
                found: b.len(),
                needed: contacts * rows,
            });
        }
        if friction.len() != contacts {
            return Err(ShapeError::Length {
                name: "friction",
                found: friction.len(),
                needed: contacts,
            });
        }
        let frictionless = law == Law::Normal || rows == 1;
        let coupled = law == Law::Coulomb && !frictionless;
        let order = if coupled {
            operator.described(b, friction).sorted()
        } else {
            None
        };
        let from = |i: usize| order.as_ref().map_or(i, |order| order[i] as usize);
        if let Some(order) = &order {
            operator = operator.in_order(order);
        }
        let weights = |diagonal: &[Vector]| -> Vec<f64> {
            diagonal
                .iter()
                .map(|d| d.iter().fold(0.0_f64, |most, &value| most.max(value)))
                .collect()
        };
        let mean = weights(&operator.diagonal()).iter().sum::<f64>() / contacts.max(1) as f64;
        let matrix_unit = if mean > 0.0 { mean } else { 1.0 };
        operator.scale(1.0 / matrix_unit);
        let mut field = vec![ZERO; contacts];
        for (i, vector) in field.iter_mut().enumerate() {
            vector[..rows].copy_from_slice(&b[from(i) * rows..][..rows]);
        }
        let most = largest(b);
        let most = if most > 0.0 { most } else { 1.0 };
        field.iter_mut().flatten().for_each(|value| *value /= most);
        let size = norm(&field) / (contacts.max(1) as f64).sqrt();
        let size = if size > 0.0 { size } else { 1.0 };
        field.iter_mut().flatten().for_each(|value| *value /= size);
        let diagonal = operator.diagonal();
        Ok(Self {
            weight: weights(&diagonal),
            diagonal,
            b_norm: norm(&field),
            impulse_unit: most * size / matrix_unit,
            operator,
            b: field,
            friction: if frictionless {
                vec![0.0; contacts]
            } else {
                (0..contacts).map(|i| friction[from(i)]).collect()
            },
            coupled,
            order,
        })
    }

    /// ‖B‖.
    pub fn b_norm(&self) -> f64 {
        self.b_norm
    }

    pub fn contacts(&self) -> usize {
        self.b.len()
    }

    /// Impulses in the caller's unit and order, rows per contact.
    pub fn to_caller(&self, p: &[Vector]) -> Vec<f64> {
        let rows = self.operator.rows();
        let mut result = vec![0.0; rows * p.len()];
        for (i, part) in p.iter().enumerate() {
            let out = &mut result[self.place(i) * rows..][..rows];
            out.iter_mut()
                .zip(part)
                .for_each(|(out, value)| *out = value * self.impulse_unit);
        }
        result
    }

    /// Impulses from the caller's unit and order.
    pub fn from_caller(&self, p: &[f64]) -> Vec<Vector> {
        let rows = self.operator.rows();
        let vector = |i: usize| {
            let mut result = ZERO;
            result
                .iter_mut()
                .zip(&p[self.place(i) * rows..][..rows])
                .for_each(|(out, value)| *out = value / self.impulse_unit);
            result
        };
        (0..self.contacts()).map(vector).collect()
    }

    /// Where the caller has contact i.
    fn place(&self, i: usize) -> usize {
        self.order.as_ref().map_or(i, |order| order[i] as usize)
    }

    /// u = A p − B.
    pub fn velocity(&self, p: &[Vector], u: &mut [Vector], scratch: &mut Vec<f64>) {
        self.operator.apply(p, u, scratch);
        for (value, b) in u.iter_mut().flatten().zip(self.b.iter().flatten()) {
            *value -= b;
        }
    }

    /// û_i: u_i with De Saxcé's correction where the law has it.
    pub fn corrected(&self, i: usize, u: &Vector) -> Vector {
        if self.coupled {
            [u[0] + self.friction[i] * tangent_norm(u), u[1], u[2]]
        } else {
            *u
        }
    }

    /// The derivative of û by u, I + μ n t̂ᵀ; None where it is the identity.
    pub fn coupling(&self, mu: f64, u: &Vector) -> Option<Matrix> {
        let slip = tangent_norm(u);
        (self.coupled && slip > 0.0).then(|| {
            [
                [1.0, mu * u[1] / slip, mu * u[2] / slip],
                IDENTITY[1],
                IDENTITY[2],
            ]
        })
    }

    /// The scale-free natural map at p.
    pub fn residual(&self, p: &[Vector]) -> f64 {
        let mut u = vec![ZERO; p.len()];
        self.velocity(p, &mut u, &mut Vec::new());
        self.natural_map(p, &u)
    }

    /// The same problem under the strongest convex law that its solutions obey: frictionless instead of Coulomb's.
    pub fn without_coupling(&self) -> Self {
        let mut other = self.clone();
        if other.coupled {
            other.coupled = false;
            other.friction.fill(0.0);
        }
        other
    }

    /// The scale-free natural map at (p, u).
    ///
    /// d p − P_K(d p − û) is û itself where the projection does nothing: said so, and not left to a difference, because
    /// impulses that run off to infinity would swallow û and look like a solution.
    pub fn natural_map(&self, p: &[Vector], u: &[Vector]) -> f64 {
        let mut sum = 0.0;
        let mut unused = IDENTITY;
        for (i, (p, u)) in p.iter().zip(u).enumerate() {
            let (d, u) = (self.weight[i], self.corrected(i, u));
            let aim = [d * p[0] - u[0], d * p[1] - u[1], d * p[2] - u[2]];
            let image = project(&aim, self.friction[i], &mut unused);
            let miss = [0, 1, 2].map(|k| {
                if image[k] == aim[k] {
                    u[k]
                } else {
                    d * p[k] - image[k]
                }
            });
            sum += dot(&miss, &miss);
        }
        let residual = sum.sqrt();
        if self.b_norm > 0.0 {
            residual / self.b_norm
        } else {
            residual
        }
    }
}

/// Keeps the best impulses seen, and the record of how the residual fell.
pub struct Best {
    pub impulse: Vec<Vector>,
    pub residual: f64,
    /// (Newton steps taken, best residual until then).
    pub history: Vec<(usize, f64)>,
    /// Whether any impulses that were seen show that there is no proof of infeasibility.
    pub is_feasible: bool,
}

impl Best {
    /// Starts at p = 0.
    pub fn new(problem: &Problem) -> Self {
        let impulse = vec![ZERO; problem.contacts()];
        let u: Vec<Vector> = problem.b.iter().map(|b| b.map(|value| -value)).collect();
        let residual = problem.natural_map(&impulse, &u);
        Self {
            impulse,
            residual,
            history: vec![(0, residual)],
            is_feasible: false,
        }
    }

    /// Takes over what a later stage found, `before` Newton steps into the whole.
    pub fn absorb(&mut self, other: Self, before: usize) {
        self.is_feasible |= other.is_feasible;
        for &(steps, residual) in other
            .history
            .iter()
            .filter(|&&(_, residual)| residual < self.residual)
        {
            self.history.push((before + steps, residual));
        }
        if other.residual < self.residual {
            self.residual = other.residual;
            self.impulse = other.impulse;
        }
    }

    /// Takes the impulses if they are better; anything not finite is not.
    pub fn offer(&mut self, steps: usize, impulse: &[Vector], residual: f64) -> bool {
        let better = residual < self.residual;
        if better {
            self.impulse.copy_from_slice(impulse);
            self.residual = residual;
            self.history.push((steps, residual));
        }
        better
    }
}
