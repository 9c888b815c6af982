//! From a stacked system to its impulses by one of the core's own methods, with the residual of what they found.

use std::time::{Duration, Instant};

use crate::contact::Law;
use crate::exact::{self, BlockMatrix};
use crate::factored::Factored;
use crate::friction_cone::{ConvexCone, Coulomb};
use crate::gauss_seidel::{self, Settings, Stop};
use crate::presolve;
use crate::program::Program;
use crate::small_matrix::Vector;
use crate::stacking::Stack;

/// How far above the tolerance, in its multiples, the start of a step may be to be swept over first, and how often.
///
/// What rests is never quite at rest: it keeps velocities of the size that the tolerance leaves, and stopping them takes
/// the start of the next step beyond it, by a factor of two as a rule. Of the settled steps of a wall of 20 rows to 1e-10,
/// the start holds for half; sweeps do for all the others, in a quarter of the time of a factorisation. A start that is
/// further off has a load to learn of, and few sweeps carry it nowhere.
const NEAR: f64 = 100.0;
const FEW_SWEEPS: usize = 20;

/// Whether the caller wants to stop; asked often.
pub type Interrupted<'a> = &'a (dyn Fn() -> bool + Sync);

/// How to solve: the method and how hard it tries.
#[derive(Clone)]
pub struct Effort {
    pub program: Program,
    pub method: Method,
    /// Bound on the residual at which the answer counts as solved.
    pub tolerance: f64,
}

#[derive(Clone)]
pub enum Method {
    Sweeps(Settings),
    Exact {
        method: exact::Method,
        tolerance: f64,
        max_iterations: usize,
        /// s
        time_limit: Option<f64>,
        presolve: bool,
        threads: usize,
    },
}

/// Why a solver stopped; solved only where the residual says so.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Status {
    #[default]
    Solved,
    MaxIterations,
    Stalled,
    Infeasible,
    NumericalError,
}

#[derive(Clone, Debug, Default)]
pub struct Answer {
    /// Rows per contact, N s.
    pub impulse: Vec<f64>,
    pub status: Status,
    /// Of the program, on the system as it was stacked.
    pub residual: f64,
    pub iterations: usize,
    pub setup: Duration,
    pub elapsed: Duration,
    pub history: Vec<(usize, f64)>,
    pub details: Details,
}

/// What only one of the methods tells.
#[derive(Clone, Debug, Default)]
pub enum Details {
    /// There was nothing to solve.
    #[default]
    Nothing,
    Sweeps(Stop),
    Exact {
        factorisations: usize,
        factor_time: Duration,
        fill: usize,
        fallbacks: Vec<&'static str>,
        infeasibility: Option<Vec<f64>>,
        presolve: Option<presolve::Summary>,
    },
}

impl Details {
    /// Of an exact method whose start was good enough.
    fn unchanged() -> Self {
        Details::Exact {
            factorisations: 0,
            factor_time: Duration::ZERO,
            fill: 0,
            fallbacks: Vec::new(),
            infeasibility: None,
            presolve: None,
        }
    }
}

/// Solve the system from the impulses `start`; None where the caller interrupts it.
pub fn solve(
    stack: &Stack,
    effort: &Effort,
    start: Option<&[f64]>,
    interrupted: Interrupted,
) -> Option<Answer> {
    if stack.b.iter().all(|value| *value == 0.0) {
        return Some(Answer {
            impulse: vec![0.0; stack.b.len()],
            ..Answer::default()
        });
    }
    // At rest the impulses of the step before are the answer, or nearly so, and this is all that is done to them.
    if let (Method::Exact { tolerance, .. }, Some(start)) = (&effort.method, start) {
        let begun = Instant::now();
        let residual = effort.program.residual(stack, start);
        let system = stack.system();
        let settled = held(
            system,
            &effort.program,
            start,
            residual,
            *tolerance,
            interrupted,
        );
        if let Some((impulse, residual)) = settled {
            return Some(Answer {
                impulse,
                status: Status::Solved,
                residual,
                elapsed: begun.elapsed(),
                history: vec![(0, residual)],
                details: Details::unchanged(),
                ..Answer::default()
            });
        }
    }
    let mut answer = match &effort.method {
        Method::Sweeps(settings) => sweep(
            stack.system(),
            &effort.program,
            settings,
            start,
            interrupted,
        )?,
        Method::Exact {
            method,
            tolerance,
            max_iterations,
            time_limit,
            presolve,
            threads,
        } => {
            let limits = exact::Limits::new(*tolerance, *max_iterations, *time_limit, interrupted);
            let presolve = presolve.then_some(*threads);
            solve_exactly(stack, &effort.program, *method, &limits, start, presolve)?
        }
    };
    answer.residual = effort.program.residual(stack, &answer.impulse);
    if answer.residual > effort.tolerance
        && answer.status == Status::Solved
        && let Method::Exact { presolve: true, .. } = &effort.method
    {
        // The parts are solved and the whole is not: at tolerances near rounding, the whole has the last word.
        let mut whole = effort.clone();
        if let Method::Exact { presolve, .. } = &mut whole.method {
            *presolve = false;
        }
        return solve(stack, &whole, Some(&answer.impulse), interrupted);
    }
    if answer.residual <= effort.tolerance {
        answer.status = Status::Solved;
    } else if answer.status == Status::Solved {
        answer.status = Status::Stalled;
    }
    Some(answer)
}

fn solve_exactly(
    stack: &Stack,
    program: &Program,
    method: exact::Method,
    limits: &exact::Limits,
    start: Option<&[f64]>,
    presolve: Option<usize>,
) -> Option<Answer> {
    let begun = Instant::now();
    let law = match program {
        Program::Normal => exact::Law::Normal,
        Program::Cone => exact::Law::Cone,
        Program::Coulomb => exact::Law::Coulomb,
        Program::Polygon(_) => unreachable!("no exact method solves polygons: refused when made"),
    };
    let free = free_motion(stack);
    let presolved = presolve.and_then(|threads| {
        let view = view(stack, law, free.as_ref());
        presolve::solve(&view, method, limits, start, threads)
    });
    if let Some(presolve::Presolved { report, summary }) = presolved {
        return answered(report, limits, begun, begun, Some(summary));
    }
    let operator = exact::Operator::Velocity(stack.whitened.clone());
    let problem = exact::Problem::new(operator, &stack.b, &stack.friction, law)
        .expect("a stack has as many entries of B and coefficients as contacts");
    let prepared = Instant::now();
    let report = exact::solve(&problem, method, limits, start);
    answered(report, limits, begun, prepared, None)
}

/// What an exact method found, as an answer; None where the caller interrupted it.
fn answered(
    report: exact::Report,
    limits: &exact::Limits,
    begun: Instant,
    prepared: Instant,
    presolve: Option<presolve::Summary>,
) -> Option<Answer> {
    if report.residual > limits.tolerance && limits.interrupted() {
        return None;
    }
    Some(Answer {
        impulse: report.impulse,
        status: match report.status {
            exact::Status::Solved => Status::Solved,
            exact::Status::MaxIterations => Status::MaxIterations,
            exact::Status::Stalled => Status::Stalled,
            exact::Status::Infeasible => Status::Infeasible,
        },
        residual: report.residual,
        iterations: report.iterations,
        setup: prepared - begun,
        elapsed: prepared.elapsed(),
        history: report.history,
        details: Details::Exact {
            factorisations: report.factorisations,
            factor_time: report.factor_time,
            fill: report.fill,
            fallbacks: report.fallbacks,
            infeasibility: report.infeasibility,
            presolve,
        },
    })
}

/// How the bodies of a stack move before its impulses; None where all contacts close, and nobody asks.
fn free_motion(stack: &Stack) -> Option<presolve::FreeMotion> {
    let apart = |contact: &[f64]| contact[0] < 0.0;
    if !stack.b.chunks_exact(stack.layout.rows).any(apart) {
        return None;
    }
    let velocity = stack.free.iter().flat_map(|free| {
        let (linear, angular) = (free.linear.to_array(), free.angular.to_array());
        let both = linear.into_iter().chain(angular);
        both.take(stack.layout.columns)
    });
    Some(presolve::FreeMotion {
        velocity: velocity.collect(),
        inverse_mass: stack.inverse_mass(),
    })
}

fn view<'a>(
    stack: &'a Stack,
    law: exact::Law,
    free: Option<&'a presolve::FreeMotion>,
) -> presolve::View<'a> {
    presolve::View {
        form: presolve::Form::Velocity,
        free,
        rows: stack.layout.rows,
        width: stack.layout.columns,
        bodies: stack.roots.len(),
        starts: &stack.whitened.starts,
        columns: &stack.whitened.columns,
        whitened: &stack.whitened.values,
        jacobian: Some(&stack.blocks),
        b: &stack.b,
        largest: presolve::largest(&stack.b),
        friction: &stack.friction,
        law,
    }
}

/// A stacked system as sweeps read it: Ĵ, B, and μ and d = max diag A_ii of each contact.
#[derive(Clone, Copy)]
pub struct System<'a> {
    pub whitened: &'a BlockMatrix,
    pub b: &'a [f64],
    pub friction: &'a [f64],
    pub scale: &'a [f64],
}

impl Stack {
    fn system(&self) -> System<'_> {
        self.system_with(&self.b)
    }

    /// With `b` in the place of B.
    pub fn system_with<'a>(&'a self, b: &'a [f64]) -> System<'a> {
        System {
            whitened: &self.whitened,
            b,
            friction: &self.friction,
            scale: &self.scale,
        }
    }
}

/// The start impulses of a step, if they are a solution, or a few sweeps make them one; with its residual. `residual` is
/// that of the start.
pub fn held(
    system: System,
    program: &Program,
    start: &[f64],
    residual: f64,
    tolerance: f64,
    interrupted: Interrupted,
) -> Option<(Vec<f64>, f64)> {
    let numbers = (system.friction, system.scale, system.b);
    if residual <= tolerance {
        return program.settled(numbers, start, residual, tolerance);
    }
    if residual > NEAR * tolerance {
        return None;
    }
    let settings = Settings {
        tolerance,
        max_sweeps: FEW_SWEEPS,
        time_limit: None,
        relaxation: 1.0,
        acceleration: true,
        threads: 1,
    };
    let swept = sweep(system, program, &settings, Some(start), interrupted)?.impulse;
    let residual = program.residual_of(system.whitened, numbers, &swept);
    program.settled(numbers, &swept, residual, tolerance)
}

/// Sweep over the contacts of a system; None where the caller interrupts it.
pub fn sweep(
    system: System,
    program: &Program,
    settings: &Settings,
    start: Option<&[f64]>,
    interrupted: Interrupted,
) -> Option<Answer> {
    let go_on = &mut || !interrupted();
    let question = Question { system, start };
    match (system.whitened.height, system.whitened.width, program) {
        (1, 3, _) | (_, 3, Program::Normal) => {
            question.sweep::<1, 3, _>(&Coulomb, true, settings, go_on)
        }
        (1, _, _) | (_, _, Program::Normal) => {
            question.sweep::<1, 6, _>(&Coulomb, true, settings, go_on)
        }
        (_, 3, program) => question.sweep_with_friction::<3>(program, settings, go_on),
        (_, _, program) => question.sweep_with_friction::<6>(program, settings, go_on),
    }
}

struct Question<'a> {
    system: System<'a>,
    start: Option<&'a [f64]>,
}

impl Question<'_> {
    fn sweep_with_friction<const D: usize>(
        &self,
        program: &Program,
        settings: &Settings,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Option<Answer> {
        match program {
            Program::Cone => self.sweep::<3, D, _>(&ConvexCone, false, settings, go_on),
            Program::Polygon(corners) => {
                self.sweep::<3, D, _>(&Program::polygon(corners), false, settings, go_on)
            }
            _ => self.sweep::<3, D, _>(&Coulomb, false, settings, go_on),
        }
    }

    /// Sweep over the first R rows of each contact, with bodies of D velocities.
    fn sweep<const R: usize, const D: usize, L: Law<R>>(
        &self,
        law: &L,
        frictionless: bool,
        settings: &Settings,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Option<Answer> {
        let begun = Instant::now();
        let Question { system, start } = *self;
        let (b, contacts) = (system.b, system.friction.len());
        let rows = system.whitened.height;
        // p is proportional to B. A power of two changes no digit, and keeps squares of tiny or huge velocities finite.
        let unit = power_of_two_above(b.iter().fold(0.0, |most, value| value.abs().max(most)));
        let first_rows = |values: &[f64]| -> Vec<Vector<R>> {
            let contacts = values.chunks_exact(rows);
            contacts
                .map(|row| std::array::from_fn(|r| row[r] / unit))
                .collect()
        };
        let target = first_rows(b);
        let start = start.map_or_else(|| vec![[0.0; R]; contacts], first_rows);
        let none = if frictionless {
            vec![0.0; contacts]
        } else {
            Vec::new()
        };
        let square: f64 = b.iter().map(|value| (value / unit) * (value / unit)).sum();
        let problem = gauss_seidel::Problem {
            target: &target,
            friction: if frictionless { &none } else { system.friction },
            scale: system.scale,
            target_norm: square.sqrt(),
        };
        let delassus = Factored::<R, D>::new(system.whitened)
            .expect("a contact of a stack touches two bodies");
        let outcome = gauss_seidel::solve(&delassus, law, &problem, &start, settings, go_on);
        let status = match outcome.stop {
            Stop::Solved => Status::Solved,
            Stop::MaxSweeps | Stop::TimeLimit => Status::MaxIterations,
            Stop::Stalled => Status::Stalled,
            Stop::NumericalError => Status::NumericalError,
            Stop::Interrupted => return None,
        };
        let mut impulse = vec![0.0; b.len()];
        for (all, p) in impulse.chunks_exact_mut(rows).zip(&outcome.impulse) {
            for r in 0..R {
                all[r] = unit * p[r];
            }
        }
        Some(Answer {
            impulse,
            status,
            residual: outcome
                .history
                .last()
                .map_or(0.0, |(_, residual)| *residual),
            iterations: outcome.sweeps,
            setup: begun.elapsed().saturating_sub(outcome.elapsed),
            elapsed: outcome.elapsed,
            history: outcome.history,
            details: Details::Sweeps(outcome.stop),
        })
    }
}

/// The power of two just above a positive number.
fn power_of_two_above(value: f64) -> f64 {
    let exponent = (value.to_bits() >> 52 & 0x7ff) as i32 - 1022;
    2.0_f64.powi(exponent)
}
