//! Which method runs when: a list of stages, tried in turn until one reaches the tolerance.
//!
//! The two methods fail on different problems. Proximal Newton with growing trust solves what rests in a dozen steps,
//! however tall, and profits from a warm start; the interior point is the quicker one wherever much slides, but the central
//! path of Coulomb's law can fold. What blows set moving is often solved soonest between the two: sweeps that take as long
//! as ten Newton steps find most of the contacts' states, and proximal Newton goes on from there (pyramids and walls at
//! random velocities: 100 steps in the place of 320, 290 in the place of 660).
//!
//! Around folds the path is followed by its length; where that stalls, mostly where A carries few digits, it is asked
//! whether there is a solution at all, and proximal Newton goes on. Its residual may climb for a hundred steps before it
//! falls for good, so that it is left much time; then the path is tried once more with a stronger smoothing of ‖u_t‖,
//! which bends it, and proximal Newton goes on from there to the end.

use std::time::Duration;

use super::active_set::active_set;
use super::infeasibility::certificate;
use super::interior_point::{Start, impulse_size, interior_point, stopping_impulses};
use super::newton_system::{NewtonSystem, Operator};
use super::problem::{Best, Limits, Problem};
use super::proximal_newton::{COLD_TRUST, Effort, WARM_TRUST, proximal_newton};
use super::small::Vector;
use super::sweeps::{Effort as Sweeping, gauss_seidel};

/// Which method runs first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    InteriorPoint,
    ProximalNewton,
}

/// Why the solver stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    Solved,
    MaxIterations,
    Stalled,
    /// The problem has no solution, and `infeasibility` proves it.
    Infeasible,
}

/// What was found: always the best impulses seen.
pub struct Report {
    pub impulse: Vec<f64>,
    pub residual: f64,
    pub status: Status,
    /// Newton steps.
    pub iterations: usize,
    pub factorisations: usize,
    pub factor_time: Duration,
    /// Values in the factors of one Newton system.
    pub fill: usize,
    pub history: Vec<(usize, f64)>,
    /// The stages that ran after the first one, in order.
    pub fallbacks: Vec<&'static str>,
    /// Impulses that move nothing and yet would have to, up to a factor; see the module of that name.
    pub infeasibility: Option<Vec<f64>>,
}

#[derive(Debug, Clone, Copy)]
enum Stage {
    /// The active-set method from the best point, while it gets on.
    ActiveSet,
    /// Gauss-Seidel from where the solve began, while it promises to be cheaper than so many Newton steps.
    Sweeps(f64),
    /// Proximal Newton from the best point while it is easy.
    Probe,
    /// Sweeps for as long as so many Newton steps; from where they end, if that is near a solution, proximal Newton, while
    /// the residual halves in so many steps.
    Settle(f64, usize),
    /// Interior point with this smoothing.
    Path(f64),
    /// The proof that there is no solution.
    Proof,
    /// Proximal Newton from where the stage before ended, while the residual halves in so many steps.
    Proximal(usize),
}

/// The stages of each method. Little smoothing is best as a rule: with ε/τ = 1e-3 the 24 hard problems of the
/// measurements (towers and walls at random velocities, capsules, rocks) take 50 steps in the geometric mean, with 1 they
/// take 67; strong smoothing finds the solutions of what is left. Measured where the path stalls, on walls of 20 rows with
/// μ = 1 and on rocks, and found no better than proximal Newton with time enough: the coupling frozen for some steps, its
/// fixed point with exact inner solves, centres carried on by momentum.
const INTERIOR_POINT: [Stage; 6] = [
    Stage::Sweeps(20.0),
    Stage::Path(1e-3),
    Stage::Proof,
    Stage::Proximal(300),
    Stage::Path(1.0),
    Stage::Proximal(usize::MAX),
];
const PROXIMAL_NEWTON: [Stage; 9] = [
    Stage::ActiveSet,
    Stage::Sweeps(20.0),
    Stage::Probe,
    Stage::Settle(10.0, 25),
    Stage::Path(1e-3),
    Stage::Proof,
    Stage::Proximal(300),
    Stage::Path(1.0),
    Stage::Proximal(usize::MAX),
];

/// With a larger residual than that, what sweeps leave is no start for proximal Newton: on struck towers it loses a hundred
/// steps there.
const SETTLED: f64 = 1e-3;

/// Solves the problem; `start`, impulses in the caller's unit, is where proximal Newton begins.
pub fn solve(problem: &Problem, method: Method, limits: &Limits, start: Option<&[f64]>) -> Report {
    let stages: &[Stage] = match method {
        Method::InteriorPoint => &INTERIOR_POINT,
        Method::ProximalNewton => &PROXIMAL_NEWTON,
    };
    let mut best = Best::new(problem);
    let mut run = Run {
        problem,
        system: None,
        start: best.impulse.clone(),
        here: best.impulse.clone(),
        trust: COLD_TRUST,
    };
    if let Some(start) = start {
        run.start = problem.from_caller(start);
        run.here.clone_from(&run.start);
        run.trust = WARM_TRUST;
        let residual = problem.residual(&run.here);
        best.offer(0, &run.here, residual);
    }
    let mut steps = 0;
    let mut fallbacks = Vec::new();
    let (mut asked, mut ray) = (false, None);
    for (index, &stage) in stages.iter().enumerate() {
        if best.residual <= limits.tolerance || limits.expired() || steps >= limits.iterations {
            break;
        }
        let skipped = match stage {
            // Problem files come as A: their contacts are seldom at rest, and the steps would be wasted.
            Stage::ActiveSet => start.is_none() && matches!(problem.operator, Operator::Impulse(_)),
            _ => false,
        };
        if skipped {
            continue;
        }
        if matches!(stage, Stage::Proof) {
            asked = true;
            ray = proof(problem, &best);
            if ray.is_some() {
                break;
            }
            continue;
        }
        let mut found = Best::new(problem);
        let rest = limits.after(steps);
        let taken = run.stage(stage, &rest, &mut found);
        if stage.name() != method.name()
            || index > 0 && !matches!(stages[index - 1], Stage::Sweeps(_))
        {
            fallbacks.push(stage.name());
        }
        // What the sweeps leave is no good start: on stacks proximal Newton is quicker from rest.
        if !matches!(stage, Stage::Sweeps(_)) {
            run.here.clone_from(&found.impulse);
            run.trust = WARM_TRUST;
        }
        best.absorb(found, steps);
        steps += taken;
    }
    let solved = best.residual <= limits.tolerance;
    if !solved && !asked {
        ray = proof(problem, &best);
    }
    let status = if solved {
        Status::Solved
    } else if ray.is_some() {
        Status::Infeasible
    } else if steps >= limits.iterations || limits.expired() {
        Status::MaxIterations
    } else {
        Status::Stalled
    };
    Report {
        impulse: problem.to_caller(&best.impulse),
        residual: best.residual,
        status,
        iterations: steps,
        factorisations: run
            .system
            .as_ref()
            .map_or(0, |system| system.factorisations),
        factor_time: run
            .system
            .as_ref()
            .map_or(Duration::ZERO, |system| system.factor_time),
        fill: run.system.as_ref().map_or(0, NewtonSystem::fill),
        history: best.history,
        fallbacks,
        infeasibility: ray.map(|ray| problem.to_caller(&ray)),
    }
}

/// The proof that the problem has no solution, where there may be one.
fn proof(problem: &Problem, best: &Best) -> Option<Vec<Vector>> {
    if best.is_feasible {
        return None;
    }
    certificate(&problem.without_coupling())
}

struct Run<'a> {
    problem: &'a Problem,
    /// Analysed when first needed.
    system: Option<NewtonSystem<'a>>,
    /// Where the solve began: at rest, or at the caller's impulses.
    start: Vec<Vector>,
    /// Where the next stage begins, if it can begin anywhere.
    here: Vec<Vector>,
    trust: f64,
}

impl<'a> Run<'a> {
    fn system(&mut self) -> &mut NewtonSystem<'a> {
        self.system
            .get_or_insert_with(|| NewtonSystem::new(&self.problem.operator))
    }

    fn stage(&mut self, stage: Stage, limits: &Limits, found: &mut Best) -> usize {
        let problem = self.problem;
        if let Stage::Sweeps(steps) = stage {
            let start = self.start.clone();
            let most = Box::new(|| steps * self.system().sweeps_per_step());
            let effort = Sweeping::Promising(most);
            gauss_seidel(problem, &start, limits, effort, found);
            return 0;
        }
        if let Stage::Settle(steps, _) = stage {
            let sweeps = steps * self.system().sweeps_per_step();
            let effort = Sweeping::Fixed(sweeps.ceil() as usize);
            gauss_seidel(problem, &self.start, limits, effort, found);
            if found.residual > SETTLED {
                return 0;
            }
            self.here.clone_from(&found.impulse);
        }
        let here = self.here.clone();
        let trust = self.trust;
        let system = self.system();
        match stage {
            Stage::Sweeps(_) | Stage::Proof => 0,
            Stage::ActiveSet => active_set(problem, system, limits, &here, found),
            Stage::Probe => {
                let effort = Effort {
                    trust,
                    inner_steps: 4,
                    only_while_easy: true,
                    // Where there is no solution, it stays easy for ever.
                    patience: 40,
                };
                proximal_newton(problem, system, limits, &here, effort, found)
            }
            Stage::Path(smoothing) => {
                let size = impulse_size(problem, &stopping_impulses(problem, system)).max(3.0);
                interior_point(
                    problem,
                    system,
                    limits,
                    Start {
                        impulse_size: size,
                        smoothing,
                    },
                    found,
                )
            }
            Stage::Settle(_, patience) | Stage::Proximal(patience) => {
                let effort = Effort {
                    trust,
                    inner_steps: 40,
                    only_while_easy: false,
                    patience,
                };
                proximal_newton(problem, system, limits, &here, effort, found)
            }
        }
    }
}

impl Method {
    fn name(self) -> &'static str {
        match self {
            Self::InteriorPoint => "interior_point",
            Self::ProximalNewton => "proximal_newton",
        }
    }
}

impl Stage {
    /// As it appears among the fallbacks.
    fn name(self) -> &'static str {
        match self {
            Self::Sweeps(_) | Self::Settle(..) => "gauss_seidel",
            Self::ActiveSet | Self::Probe | Self::Proximal(_) => "proximal_newton",
            Self::Path(_) => "interior_point",
            Self::Proof => "infeasibility",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{BlockMatrix, Law, Operator};
    use super::*;

    fn point_on_plane(b: [f64; 3], law: Law) -> Problem {
        let values = vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let matrix = BlockMatrix::new(vec![0, 1], vec![0], values, (3, 3), 1).unwrap();
        Problem::new(Operator::Velocity(matrix), &b, &[0.5], law).unwrap()
    }

    /// n equal masses on one axis, as Ĵ; B is the closing velocity of the lowest.
    fn column(n: usize) -> Problem {
        let mut starts = vec![0];
        let (mut columns, mut values) = (Vec::new(), Vec::new());
        for i in 0..n {
            if i > 0 {
                columns.push(i as u32 - 1);
                values.push(-1.0);
            }
            columns.push(i as u32);
            values.push(1.0);
            starts.push(columns.len());
        }
        let matrix = BlockMatrix::new(starts, columns, values, (1, 1), n).unwrap();
        let mut b = vec![0.0; n];
        b[0] = 1.0;
        Problem::new(Operator::Velocity(matrix), &b, &vec![0.0; n], Law::Normal).unwrap()
    }

    fn limits(tolerance: f64, iterations: usize) -> Limits<'static> {
        Limits::new(tolerance, iterations, None, &|| false)
    }

    const METHODS: [Method; 2] = [Method::InteriorPoint, Method::ProximalNewton];

    #[test]
    fn a_sliding_point_is_braked_by_friction_times_load() {
        for method in METHODS {
            // B = −(v_free): falling at 1, sliding at (3, 4).
            let problem = point_on_plane([1.0, -3.0, -4.0], Law::Coulomb);
            let report = solve(&problem, method, &limits(1e-12, 100), None);
            assert_eq!(report.status, Status::Solved);
            for (value, exact) in report.impulse.iter().zip([1.0, -0.3, -0.4]) {
                assert!((value - exact).abs() < 1e-10, "{method:?} {value}");
            }
        }
    }

    #[test]
    fn the_convex_law_opens_the_sliding_contact() {
        for method in METHODS {
            let problem = point_on_plane([1.0, -3.0, -4.0], Law::Cone);
            let report = solve(&problem, method, &limits(1e-12, 100), None);
            assert!(
                (report.impulse[0] - (1.0 + 0.5 * 5.0) / 1.25).abs() < 1e-10,
                "{method:?}"
            );
        }
    }

    #[test]
    fn a_column_of_any_height_takes_few_steps() {
        for method in METHODS {
            for n in [10, 100, 1000] {
                let report = solve(&column(n), method, &limits(1e-9, 60), None);
                assert_eq!(report.status, Status::Solved, "{method:?} {n}");
                assert!((report.impulse[0] - n as f64).abs() < 1e-4 * n as f64);
            }
        }
    }

    #[test]
    fn a_column_of_a_thousand_masses_has_a_short_factor() {
        let report = solve(
            &column(1000),
            Method::ProximalNewton,
            &limits(1e-9, 60),
            None,
        );
        assert!(report.fill < 50_000, "{}", report.fill);
    }
}
