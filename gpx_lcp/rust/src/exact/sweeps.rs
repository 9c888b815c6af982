//! A few sweeps of block Gauss-Seidel before anything is factored, and more of them only if they will get there soon; or
//! so many, as a start for a Newton method.
//!
//! Where contacts hardly influence each other, twenty sweeps reach 1e-8 and cost less than one factorisation. The rate at
//! which the residual falls tells how many more are needed; it is read again each time their number has doubled.

use std::array::from_fn;

use crate::contact::Law;
use crate::delassus::{BlockRows, Delassus};
use crate::explicit::Explicit;
use crate::factored::{Blocks, Factored};
use crate::friction_cone::{ConvexCone, Coulomb};
use crate::gauss_seidel::{History, Problem as Sweeping, Settings, solve_while};

use super::block_matrix::BlockMatrix;
use super::newton_system::Operator;
use super::problem::{Best, Limits, Problem};
use super::small::{Vector, ZERO};

/// Sweeps that are always done, the rate being read off their second half.
const TRIAL: usize = 20;
/// Fewer sweeps than that cost less than it costs to find out what a Newton step costs.
const CHEAP: f64 = 60.0;
/// More sweeps than that are never worth asking what a Newton step costs.
const HOPELESS: f64 = 2000.0;

/// How long to sweep.
pub enum Effort<'a> {
    /// So many sweeps.
    Fixed(usize),
    /// As long as they promise to get there within a number of sweeps, which is asked only when the first look promising.
    Promising(Box<dyn FnOnce() -> f64 + 'a>),
}

/// Sweeps from `start` and offers the result to `best`.
pub fn gauss_seidel(
    problem: &Problem,
    start: &[Vector],
    limits: &Limits,
    effort: Effort,
    best: &mut Best,
) {
    match &problem.operator {
        Operator::Impulse(a) => match a.height {
            1 => explicit::<1>(a, problem, start, limits, effort, best),
            2 => explicit::<2>(a, problem, start, limits, effort, best),
            _ => explicit::<3>(a, problem, start, limits, effort, best),
        },
        Operator::Velocity(factor) => match (factor.height, factor.width) {
            (1, 1) => factored::<1, 1>(factor, problem, start, limits, effort, best),
            (1, 2) => factored::<1, 2>(factor, problem, start, limits, effort, best),
            (1, 3) => factored::<1, 3>(factor, problem, start, limits, effort, best),
            (1, 6) => factored::<1, 6>(factor, problem, start, limits, effort, best),
            (2, 2) => factored::<2, 2>(factor, problem, start, limits, effort, best),
            (2, 3) => factored::<2, 3>(factor, problem, start, limits, effort, best),
            (3, 3) => factored::<3, 3>(factor, problem, start, limits, effort, best),
            (3, 6) => factored::<3, 6>(factor, problem, start, limits, effort, best),
            // Any other shape of body is rare enough to go without.
            _ => {}
        },
    }
}

fn explicit<const R: usize>(
    a: &BlockMatrix,
    problem: &Problem,
    start: &[Vector],
    limits: &Limits,
    effort: Effort,
    best: &mut Best,
) {
    let rows = BlockRows::of(a);
    with_law::<R, _>(Explicit::new(rows), problem, start, limits, effort, best);
}

fn factored<const R: usize, const D: usize>(
    factor: &BlockMatrix,
    problem: &Problem,
    start: &[Vector],
    limits: &Limits,
    effort: Effort,
    best: &mut Best,
) {
    // Contacts of more than two bodies are rare enough to go without, too.
    if let Some(delassus) = Factored::<R, D, _>::new(factor, Blocks) {
        with_law::<R, _>(delassus, problem, start, limits, effort, best);
    }
}

fn with_law<const R: usize, A: Delassus<R>>(
    delassus: A,
    problem: &Problem,
    start: &[Vector],
    limits: &Limits,
    effort: Effort,
    best: &mut Best,
) {
    if problem.coupled {
        sweep(delassus, &Coulomb, problem, start, limits, effort, best);
    } else {
        sweep(delassus, &ConvexCone, problem, start, limits, effort, best);
    }
}

fn sweep<const R: usize, A: Delassus<R>, L: Law<R>>(
    delassus: A,
    law: &L,
    problem: &Problem,
    start: &[Vector],
    limits: &Limits,
    effort: Effort,
    best: &mut Best,
) {
    let target: Vec<[f64; R]> = problem
        .b
        .iter()
        .map(|vector| from_fn(|r| vector[r]))
        .collect();
    let asked = Sweeping {
        target: &target,
        friction: &problem.friction,
        scale: &problem.weight,
        target_norm: problem.b_norm(),
    };
    let (max_sweeps, most) = match effort {
        Effort::Fixed(sweeps) => (sweeps, None),
        Effort::Promising(most) => (usize::MAX, Some(most)),
    };
    let settings = Settings {
        tolerance: limits.tolerance,
        max_sweeps,
        time_limit: limits.left(),
        relaxation: 1.0,
        acceleration: true,
        threads: 1,
    };
    let mut outlook = most.map(|most| Outlook {
        tolerance: limits.tolerance,
        most: Some(most),
        budget: f64::INFINITY,
        next: TRIAL,
    });
    let start: Vec<[f64; R]> = start.iter().map(|p| from_fn(|r| p[r])).collect();
    let outcome = solve_while(
        &delassus,
        law,
        &asked,
        &start,
        &settings,
        &mut || !limits.interrupted(),
        &mut |history, _| {
            outlook
                .as_mut()
                .is_none_or(|outlook| outlook.promising(history))
        },
    );
    let residual = outcome
        .history
        .last()
        .map_or(f64::INFINITY, |&(_, residual)| residual);
    let impulse = outcome.impulse;
    let impulse: Vec<Vector> = impulse
        .iter()
        .map(|part| {
            let mut vector = ZERO;
            vector[..R].copy_from_slice(part);
            vector
        })
        .collect();
    best.offer(0, &impulse, residual);
}

/// Whether to go on sweeping, from how the residual falls.
struct Outlook<F> {
    tolerance: f64,
    /// Tells the number of sweeps that may be needed; not asked before it matters.
    most: Option<F>,
    budget: f64,
    /// The next number of sweeps at which to look.
    next: usize,
}

impl<F: FnOnce() -> f64> Outlook<F> {
    fn promising(&mut self, history: &History) -> bool {
        let Some(&(done, residual)) = history.last() else {
            return true;
        };
        if done < self.next {
            return true;
        }
        self.next = 2 * done;
        // Over the second half, which knows nothing of the quick start.
        let (first, before) = history[history.partition_point(|&(sweeps, _)| 2 * sweeps < done)];
        let rate = (before / residual).ln() / (done - first) as f64;
        let needed = (residual / self.tolerance).ln() / rate;
        if rate <= 0.0 || needed.is_nan() || needed > HOPELESS {
            return false;
        }
        if needed > CHEAP
            && let Some(most) = self.most.take()
        {
            self.budget = most();
        }
        done as f64 + needed <= self.budget
    }
}
