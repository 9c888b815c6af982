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
//! Acceleration gives the sweeps momentum (Nesterov): sweep k starts from p + β (p - x), p being where the last sweep has
//! led and x where the one before it had, β = (t - 1)/t' with t' = (1 + √(1 + 4t²))/2. Where the last sweep went against
//! the way from x to p, the momentum is lost: t = 1. Coulomb's law is no gradient of anything, and momentum may run in
//! circles: where the residual has grown between two evaluations, t may not grow as far again for a while.
//!
//! Impulses may also drift. A brick whose gaps to what it stands on differ by δ cannot close them all, and as long as none
//! opens each sweep carries the same δ/(d dt) of load from one contact to another: the residual stands still, at a rate
//! that would take millions of sweeps. There β is a little above 1, so that the drift grows geometrically until it ends.
//!
//! Sources: Y. Nesterov, *A method of solving a convex programming problem with convergence rate O(1/k²)* (1983);
//! H. Mazhar, T. Heyn, D. Negrut, A. Tasora, *Using Nesterov's method to accelerate multibody dynamics with friction and
//! contact*, ACM Transactions on Graphics 34 (2015); B. O'Donoghue, E. Candès, *Adaptive restart for accelerated gradient
//! schemes*, Foundations of Computational Mathematics 15 (2015). Departures: (1) a sweep stands for the projected gradient
//! step, so that a start beyond the cones does no harm; (2) directions are compared with the weights d_i, so that they
//! have no unit of their own. Measured against the alternatives by `python -m benchmarks run acceleration`.

use std::time::{Duration, Instant};

use crate::contact::Law;
use crate::delassus::{Delassus, Sweeper};
use crate::small_matrix::Vector;
use crate::team::Team;

/// Sweeps between two evaluations of the residual; one evaluation costs about one sweep.
const CHECK_EVERY: usize = 10;
/// Evaluations without progress after which the iteration counts as stalled, and the least share that is progress.
///
/// A column of n equal masses gains (π/2n)² a sweep, so over this window n may be as large as 8000.
const PATIENCE: usize = 300;
const LEAST_PROGRESS: f64 = 1e-4;
/// Share by which a residual that grows is larger than the one before: less may be rounding, or a wobble of momentum.
const GROWTH: f64 = 0.1;
/// Share by which the residual changes between two evaluations, at most, where impulses drift; and β there.
const STANDSTILL: f64 = 1e-2;
const DRIFT: f64 = 1.05;
/// How often the caller is asked whether to go on.
const POLL_EVERY: Duration = Duration::from_millis(50);
/// Contacts of each thread, at least. On walls of 1 600 contacts two threads take a tenth longer than one, on 3 700 a tenth
/// less: they wait for each other after every colour.
const WORTH_A_THREAD: usize = 1024;

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
    let promising = &mut |_: &History, _: &dyn Fn() -> Vec<Vector<R>>| true;
    solve_while(delassus, law, problem, start, settings, go_on, promising)
}

/// Who looks at the history of residuals and, if need be, at the impulses, and says whether they are promising.
pub type Promising<'a, const R: usize> =
    &'a mut dyn FnMut(&History, &dyn Fn() -> Vec<Vector<R>>) -> bool;

/// The same, while what is shown at every evaluation that is not the last is found promising.
pub fn solve_while<const R: usize, A: Delassus<R>, L: Law<R>>(
    delassus: &A,
    law: &L,
    problem: &Problem<R>,
    start: &[Vector<R>],
    settings: &Settings,
    go_on: &mut dyn FnMut() -> bool,
    promising: Promising<R>,
) -> Outcome<R> {
    let watch = Watch { go_on, promising };
    let threads = Team::worth(settings.threads, problem.target.len(), WORTH_A_THREAD);
    Team::with(threads, |team| {
        let mut sweeper = delassus.sweeper(law, problem, start, team);
        iterate(&mut sweeper, team, problem, settings, watch)
    })
}

/// Who is asked along the way whether to go on.
struct Watch<'a, const R: usize> {
    go_on: &'a mut dyn FnMut() -> bool,
    promising: Promising<'a, R>,
}

fn iterate<const R: usize>(
    sweeper: &mut impl Sweeper<R>,
    team: &Team,
    problem: &Problem<R>,
    settings: &Settings,
    watch: Watch<R>,
) -> Outcome<R> {
    let Watch { go_on, promising } = watch;
    let begun = Instant::now();
    let mut polled = begun;
    let mut history = Vec::new();
    let mut best = (f64::INFINITY, sweeper.impulse());
    let mut milestone = (0, f64::INFINITY);
    let mut momentum = Momentum::default();
    let mut agreement = 0.0;
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
            momentum.judge(residual);
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
            if !promising(&history, &|| sweeper.impulse()) {
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
        let beta = settings.acceleration.then(|| match sweeps {
            0 => 0.0,
            _ => momentum.beta(agreement),
        });
        agreement = sweeper.sweep(team, settings.relaxation, beta);
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

/// How far a sweep starts beyond where the last has led.
struct Momentum {
    /// t
    inertia: f64,
    /// The largest t that is let grow: where sliding contacts make momentum run in circles, it shrinks until there is none.
    most: f64,
    /// The residual at the last evaluation.
    residual: f64,
    /// Whether it was that of the evaluation before, and no sweep since has turned back.
    drifts: bool,
}

impl Default for Momentum {
    fn default() -> Self {
        Self {
            inertia: 1.0,
            most: f64::INFINITY,
            residual: f64::INFINITY,
            drifts: false,
        }
    }
}

impl Momentum {
    /// The next β.
    fn beta(&mut self, agreement: f64) -> f64 {
        if agreement < 0.0 {
            self.inertia = 1.0;
            self.drifts = false;
        }
        let next = 0.5 * (1.0 + (1.0 + 4.0 * self.inertia * self.inertia).sqrt());
        let beta = (self.inertia - 1.0) / next;
        self.inertia = next.min(self.most);
        // Not where momentum has just begun, or may not grow because it ran in circles.
        if self.drifts && self.inertia > 2.0 {
            DRIFT
        } else {
            beta
        }
    }

    /// Take the residual between two sweeps into account.
    fn judge(&mut self, residual: f64) {
        // Before the first evaluation there is none to compare with: the quotient is 0 then.
        self.drifts = (residual / self.residual - 1.0).abs() <= STANDSTILL;
        if residual > (1.0 + GROWTH) * self.residual {
            self.most = (0.5 * self.inertia.min(self.most)).max(1.0);
            self.inertia = 1.0;
        } else {
            self.most *= 1.5;
        }
        self.residual = residual;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exact::BlockMatrix;
    use crate::factored::{Blocks, Factored};
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
        for k in 0..n as u32 {
            if k > 0 {
                bodies.push(k - 1);
                data.push(-1.0);
            }
            bodies.push(k);
            data.push(1.0);
            ends.push(bodies.len());
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
        let rows = BlockMatrix::new(ends, bodies, data, (1, 1), n).unwrap();
        let delassus = Factored::<1, 1, _>::new(&rows, Blocks).unwrap();
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
            10 * accelerated.sweeps < plain.sweeps,
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
