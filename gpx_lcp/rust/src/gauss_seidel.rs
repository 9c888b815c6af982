//! Projected block Gauss-Seidel (nonsmooth Gauss-Seidel, NSGS): visit the contacts in order, solve each one exactly with
//! the others held, repeat.
//!
//! Sources: M. Jean and J. J. Moreau, *Unilaterality and dry friction in the dynamics of rigid body collections* (1992);
//! V. Acary, M. Brémond, O. Huber, *On solving contact problems with Coulomb friction*, INRIA RR-9118 (2018), alg. NSGS-AC.
//! Departures: (1) the local problem is solved by one scalar equation instead of a nonsmooth Newton method in 3-D, and a
//! contact that goes on sliding takes one Newton step of it a visit: the fixed point is the same;
//! (2) it stops on the natural map of the whole problem, never on the change between iterates, which is small wherever
//! convergence is slow; (3) A may be given as Ĵ, and is then never formed.
//!
//! Acceleration makes of the sweeps a nonlinear conjugate gradient method (NNCG): two sweeps, there and back, are the
//! preconditioned gradient g, and the next two start from p + β d with d the previous direction and β the ratio of the
//! squared lengths of g (Fletcher and Reeves), or from p itself whenever g has grown.
//! Source: M. Silcowitz, S. Niebe, K. Erleben, *A nonsmooth nonlinear conjugate gradient method for interactive contact
//! force problems*, The Visual Computer 26 (2010). Departures: (1) sweeps go there and back, as conjugacy asks for a
//! symmetric preconditioner; (2) lengths are measured with the weights d_i, so that they have no unit of their own.

use std::time::{Duration, Instant};

use crate::contact::Law;
use crate::delassus::{Delassus, Sweeper};
use crate::small_matrix::{Vector, dot};
use crate::team::Team;

/// Sweeps between two evaluations of the residual; one evaluation costs about one sweep.
const CHECK_EVERY: usize = 10;
/// Evaluations without progress after which the iteration counts as stalled, and the least share that is progress.
///
/// A column of n equal masses gains (π/2n)² a sweep, so over this window n may be as large as 8000.
const PATIENCE: usize = 300;
const LEAST_PROGRESS: f64 = 1e-4;
/// How often the caller is asked whether to go on.
const POLL_EVERY: Duration = Duration::from_millis(50);

/// (sweeps done, residual) at every evaluation.
pub type History = [(usize, f64)];

/// What is asked, beside A.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a, const R: usize> {
    /// B by contact, m/s.
    pub target: &'a [Vector<R>],
    pub friction: &'a [f64],
    /// d_i by contact, 1/kg, and ‖B‖, m/s: the measures in which the residual is stated. They are those of the whole
    /// system, also where A holds the normal rows alone.
    pub scale: &'a [f64],
    pub target_norm: f64,
}

/// How hard to try.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Bound on the residual ‖d p - P(d p - û)‖/‖B‖.
    pub tolerance: f64,
    pub max_sweeps: usize,
    pub time_limit: Option<Duration>,
    /// ω in (0, 2): the step taken, as a multiple of the exact local step.
    pub relaxation: f64,
    pub acceleration: bool,
    /// At least one; the result does not depend on it.
    pub threads: usize,
}

/// Why the iteration stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    Solved,
    MaxSweeps,
    TimeLimit,
    Stalled,
    NumericalError,
    Interrupted,
}

/// The last iterate where it was still converging, the best evaluated one otherwise.
#[derive(Clone, Debug)]
pub struct Outcome<const R: usize> {
    pub impulse: Vec<Vector<R>>,
    pub stop: Stop,
    pub sweeps: usize,
    /// (sweeps done, residual) at every evaluation.
    pub history: Vec<(usize, f64)>,
    /// Time of the sweeps and evaluations, without what is done once before them.
    pub elapsed: Duration,
}

/// Solve the contact problem from the impulse `start`.
///
/// Contacts with a diagonal block of zeros (between locked bodies) keep a zero impulse: it would not change anything.
/// `go_on` is asked every 50 ms.
pub fn solve<const R: usize, A: Delassus<R>, L: Law<R>>(
    delassus: &A,
    law: &L,
    problem: &Problem<R>,
    start: &[Vector<R>],
    settings: &Settings,
    go_on: &mut dyn FnMut() -> bool,
) -> Outcome<R> {
    solve_while(delassus, law, problem, start, settings, go_on, &mut |_| {
        true
    })
}

/// The same, while the history of residuals, shown at every evaluation that is not the last, is found promising.
pub fn solve_while<const R: usize, A: Delassus<R>, L: Law<R>>(
    delassus: &A,
    law: &L,
    problem: &Problem<R>,
    start: &[Vector<R>],
    settings: &Settings,
    go_on: &mut dyn FnMut() -> bool,
    promising: &mut dyn FnMut(&History) -> bool,
) -> Outcome<R> {
    let mut sweeper = delassus.sweeper(law, problem, start);
    let watch = Watch { go_on, promising };
    Team::with(settings.threads.min(sweeper.threads()), |team| {
        iterate(&mut sweeper, team, problem, settings, watch)
    })
}

/// Who is asked along the way whether to go on.
struct Watch<'a> {
    go_on: &'a mut dyn FnMut() -> bool,
    promising: &'a mut dyn FnMut(&History) -> bool,
}

fn iterate<const R: usize>(
    sweeper: &mut impl Sweeper<R>,
    team: &Team,
    problem: &Problem<R>,
    settings: &Settings,
    watch: Watch,
) -> Outcome<R> {
    let Watch { go_on, promising } = watch;
    let begun = Instant::now();
    let mut polled = begun;
    let mut history = Vec::new();
    let mut best = (f64::INFINITY, sweeper.impulse());
    let mut milestone = (0, f64::INFINITY);
    let mut momentum = Momentum::new(&best.1);
    let mut sweeps = 0;
    let stop = loop {
        if sweeps % CHECK_EVERY == 0 || sweeps == settings.max_sweeps {
            let length = sweeper.residual(team);
            let residual = if length == 0.0 {
                0.0
            } else {
                length / problem.target_norm
            };
            history.push((sweeps, residual));
            if residual <= settings.tolerance {
                break Stop::Solved;
            }
            if !residual.is_finite() {
                break Stop::NumericalError;
            }
            // The start is no candidate: a cold start would often win against the first sweeps and exert nothing.
            if residual < best.0 && sweeps > 0 {
                best = (residual, sweeper.impulse());
            }
            if residual < (1.0 - LEAST_PROGRESS) * milestone.1 {
                milestone = (history.len(), residual);
            } else if history.len() - milestone.0 >= PATIENCE {
                break Stop::Stalled;
            }
            if sweeps == settings.max_sweeps {
                break Stop::MaxSweeps;
            }
            if !promising(&history) {
                break Stop::Interrupted;
            }
        }
        let now = Instant::now();
        if settings
            .time_limit
            .is_some_and(|limit| now - begun >= limit)
        {
            break Stop::TimeLimit;
        }
        if now - polled >= POLL_EVERY {
            polled = now;
            if !go_on() {
                break Stop::Interrupted;
            }
        }
        let backward = settings.acceleration && sweeps % 2 == 1;
        if settings.acceleration && sweeps > 0 && !backward {
            let mut impulse = sweeper.impulse();
            momentum.extrapolate(&mut impulse, problem.scale);
            sweeper.set(&impulse, team);
        }
        sweeper.sweep(team, backward, settings.relaxation);
        sweeps += 1;
    };
    let impulse = match stop {
        Stop::Stalled | Stop::NumericalError => best.1,
        _ => sweeper.impulse(),
    };
    Outcome {
        impulse,
        stop,
        sweeps,
        history,
        elapsed: begun.elapsed(),
    }
}

/// What acceleration remembers.
struct Momentum<const R: usize> {
    /// Where the last two sweeps started.
    before: Vec<Vector<R>>,
    direction: Vec<Vector<R>>,
    /// Σ d_i ‖g_i‖² of the last gradient; zero at the start.
    square: f64,
}

impl<const R: usize> Momentum<R> {
    fn new(start: &[Vector<R>]) -> Self {
        Self {
            before: start.to_vec(),
            direction: vec![[0.0; R]; start.len()],
            square: 0.0,
        }
    }

    /// Start the next two sweeps further along; the iterate may leave the cones until they have visited it.
    fn extrapolate(&mut self, impulse: &mut [Vector<R>], scale: &[f64]) {
        let mut length = 0.0;
        for ((p, start), d) in impulse.iter().zip(&self.before).zip(scale) {
            let gradient: Vector<R> = std::array::from_fn(|r| p[r] - start[r]);
            length += d * dot(&gradient, &gradient);
        }
        let beta = if length <= self.square && self.square > 0.0 {
            length / self.square
        } else {
            0.0
        };
        self.square = length;
        let memory = self.before.iter_mut().zip(&mut self.direction);
        for (p, (start, direction)) in impulse.iter_mut().zip(memory) {
            for r in 0..R {
                let gradient = p[r] - start[r];
                let step = beta * direction[r];
                p[r] += step;
                start[r] = p[r];
                direction[r] = step + gradient;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delassus::BlockRows;
    use crate::factored::Factored;
    use crate::friction_cone::Coulomb;

    const SETTINGS: Settings = Settings {
        tolerance: 1e-10,
        max_sweeps: 10_000,
        time_limit: None,
        relaxation: 1.0,
        acceleration: false,
        threads: 1,
    };

    /// Solve n equal masses on one another under a unit step of gravity; the exact impulses are n, n - 1, ..., 1.
    fn column(
        n: usize,
        start: f64,
        settings: &Settings,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Outcome<1> {
        let (mut ends, mut bodies, mut data) = (vec![0], Vec::new(), Vec::new());
        for k in 0..n as i64 {
            if k > 0 {
                bodies.push(k - 1);
                data.push(-1.0);
            }
            bodies.push(k);
            data.push(1.0);
            ends.push(bodies.len() as i64);
        }
        let mut target = vec![[0.0]; n];
        target[0] = [1.0];
        let mut scale = vec![2.0; n];
        scale[0] = 1.0;
        let problem = Problem {
            target: &target,
            friction: &vec![0.0; n],
            scale: &scale,
            target_norm: 1.0,
        };
        let rows = BlockRows::<1, 1>::new(&ends, &bodies, &data, n).unwrap();
        let delassus = Factored::<1, 1>::new(&rows, n).unwrap();
        solve(
            &delassus,
            &Coulomb,
            &problem,
            &vec![[start]; n],
            settings,
            go_on,
        )
    }

    #[test]
    fn column_carries_the_weight_above() {
        let outcome = column(6, 0.0, &SETTINGS, &mut || true);
        assert_eq!(outcome.stop, Stop::Solved);
        for (k, p) in outcome.impulse.iter().enumerate() {
            assert!((p[0] - (6 - k) as f64).abs() < 1e-8);
        }
        assert_eq!(outcome.history.len(), outcome.sweeps / CHECK_EVERY + 1);
    }

    #[test]
    fn acceleration_needs_far_fewer_sweeps() {
        let plain = column(40, 0.0, &SETTINGS, &mut || true);
        let accelerated = column(
            40,
            0.0,
            &Settings {
                acceleration: true,
                ..SETTINGS
            },
            &mut || true,
        );
        assert_eq!(accelerated.stop, Stop::Solved);
        assert!(
            5 * accelerated.sweeps < plain.sweeps,
            "{} of {}",
            accelerated.sweeps,
            plain.sweeps
        );
    }

    #[test]
    fn overflow_is_a_numerical_error_with_a_finite_impulse() {
        let outcome = column(
            6,
            1e300,
            &Settings {
                max_sweeps: 30,
                ..SETTINGS
            },
            &mut || true,
        );
        assert_eq!(outcome.stop, Stop::NumericalError);
        assert!(outcome.impulse.iter().all(|p| p[0].is_finite()));
    }

    #[test]
    fn caller_can_interrupt() {
        let settings = Settings {
            tolerance: 0.0,
            max_sweeps: usize::MAX,
            ..SETTINGS
        };
        let outcome = column(5000, 0.0, &settings, &mut || false);
        assert_eq!(outcome.stop, Stop::Interrupted);
    }
}
