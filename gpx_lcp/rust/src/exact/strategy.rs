//! Which method runs when: a list of stages, tried in turn until one reaches the tolerance.
//!
//! The two methods fail on different problems. Proximal Newton with growing trust solves what rests in a dozen steps,
//! however tall, and profits from a warm start; the interior point is the quicker one wherever much slides, but the central
//! path of Coulomb's law can fold, and then it stalls at 1e-2 … 1e-6; from there proximal Newton gets home. A stronger
//! smoothing of ‖u_t‖ bends the path, which helps where all that fails.

use super::infeasibility::certificate;
use super::interior_point::{Start, interior_point};
use super::newton_system::NewtonSystem;
use super::problem::{Best, Limits, Problem};
use super::proximal_newton::{COLD_TRUST, Effort, WARM_TRUST, impulse_size, proximal_newton};
use super::small::Vector;
use super::sweeps::gauss_seidel;

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
    /// Gauss-Seidel from rest, while it promises to be cheaper than so many Newton steps.
    Sweeps(f64),
    /// Proximal Newton from the best point while it is easy.
    Probe,
    /// Interior point with this smoothing.
    Path(f64),
    /// Proximal Newton from where the stage before ended, while the residual halves in so many steps.
    Proximal(usize),
}

/// The stages of each method. The numbers of steps were measured: see the benchmark of the exact solvers.
const INTERIOR_POINT: [Stage; 4] = [
    Stage::Path(1.0),
    Stage::Proximal(80),
    Stage::Path(10.0),
    Stage::Proximal(200),
];
const PROXIMAL_NEWTON: [Stage; 6] = [
    Stage::Sweeps(10.0),
    Stage::Probe,
    Stage::Path(1.0),
    Stage::Proximal(80),
    Stage::Path(10.0),
    Stage::Proximal(200),
];

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
        here: best.impulse.clone(),
        trust: COLD_TRUST,
    };
    if let Some(start) = start {
        run.here = problem.from_caller(start);
        run.trust = WARM_TRUST;
        let residual = problem.residual(&run.here);
        best.offer(0, &run.here, residual);
    }
    let mut steps = 0;
    let mut fallbacks = Vec::new();
    for (index, &stage) in stages.iter().enumerate() {
        if best.residual <= limits.tolerance || limits.expired() || steps >= limits.iterations {
            break;
        }
        if start.is_some() && matches!(stage, Stage::Sweeps(_)) {
            continue;
        }
        let mut found = Best::new(problem);
        let rest = Limits {
            iterations: limits.iterations - steps,
            ..*limits
        };
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
    let mut infeasibility = None;
    let status = if best.residual <= limits.tolerance {
        Status::Solved
    } else if let Some(ray) = certificate(&problem.without_coupling()) {
        infeasibility = Some(problem.to_caller(&ray));
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
        fill: run.system.as_ref().map_or(0, NewtonSystem::fill),
        history: best.history,
        fallbacks,
        infeasibility,
    }
}

struct Run<'a> {
    problem: &'a Problem,
    /// Analysed when first needed.
    system: Option<NewtonSystem<'a>>,
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
            let most = || steps * self.system().sweeps_per_step();
            gauss_seidel(problem, limits, most, found);
            return 0;
        }
        let here = self.here.clone();
        let trust = self.trust;
        let system = self.system();
        match stage {
            Stage::Sweeps(_) => 0,
            Stage::Probe => {
                let effort = Effort {
                    trust,
                    inner_steps: 4,
                    only_while_easy: true,
                    patience: usize::MAX,
                };
                proximal_newton(problem, system, limits, &here, effort, found)
            }
            Stage::Path(smoothing) => {
                let size = impulse_size(problem, &here).max(3.0);
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
            Stage::Proximal(patience) => {
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
    fn name(self) -> &'static str {
        match self {
            Self::Sweeps(_) => "gauss_seidel",
            Self::Probe | Self::Proximal(_) => "proximal_newton",
            Self::Path(_) => "interior_point",
        }
    }
}
