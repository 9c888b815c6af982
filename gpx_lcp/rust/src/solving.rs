//! From a stacked system to its impulses by one of the core's own methods, with the residual of what they found.

use std::borrow::Cow;
use std::ops::Range;
use std::time::{Duration, Instant};

use crate::arms::{Masses, Rigid};
use crate::exact::{self, BlockMatrix, Limits, Operator};
use crate::gauss_seidel::{Settings, Stop};
use crate::pooling::{are_mostly_done, swept};
use crate::presolve::{self, Form, Found, FreeMotion, Part, Reduced, Remembered};
use crate::program::Program;
use crate::stacking::Stack;
use crate::sweeping::{Look, sweep};

/// How far above the tolerance, in its multiples, the start of a step may be for an exact method to sweep over it first, and
/// how often.
///
/// What rests is never quite at rest: it keeps velocities of the size that the tolerance leaves, and they add up until the
/// start does not hold. It then misses by little, and sweeps do, in a quarter of the time of a factorisation. A start that
/// is further off has a load to learn of, and few sweeps carry it nowhere.
const NEAR: f64 = 100.0;
const FEW_SWEEPS: usize = 20;
/// What a method aims at, as a share of the tolerance: a hair less, so that the rounding of whoever judges the answer does
/// not turn down what was accepted here.
const AIM: f64 = 1.0 - 1e-6;
/// A tolerance below the rounding of a residual is never reached,
pub const FINEST: f64 = 1e-15;
/// and no sweep improves on an answer that leaves less than this.
const ROUNDED: f64 = 1e-14;

/// Whether the caller wants to stop; asked often.
pub type Interrupted<'a> = &'a (dyn Fn() -> bool + Sync);

/// How to solve: the method and how hard it tries.
#[derive(Clone)]
pub struct Effort {
    pub program: Program,
    pub method: Method,
    /// Bound on the residual at which the answer counts as solved.
    pub tolerance: f64,
    /// Sweeps, or Newton steps.
    pub max_iterations: usize,
    /// s
    pub time_limit: Option<f64>,
    /// Whether the smallest systems with the same answer are solved in the place of this one. There are none for polygons.
    pub presolve: bool,
    /// At least one; the answer does not depend on it.
    pub threads: usize,
}

#[derive(Clone, Copy)]
pub enum Method {
    Sweeps { relaxation: f64, acceleration: bool },
    Exact(exact::Method),
}

impl Method {
    /// Of an answer that took no iteration.
    fn details(self) -> Details {
        match self {
            Method::Sweeps { .. } => Details::Sweeps(Stop::Solved),
            Method::Exact(_) => Details::Exact(Factored::default()),
        }
    }
}

/// Why a solver stopped; solved only where the residual says so. The worse, the later.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Status {
    #[default]
    Solved,
    Stalled,
    MaxIterations,
    Infeasible,
    NumericalError,
}

#[derive(Clone, Debug, Default)]
pub struct Answer {
    /// Rows per contact, N s.
    pub impulse: Vec<f64>,
    pub status: Status,
    /// Of the program, on the system as it was asked.
    pub residual: f64,
    /// Ĵᵀ p, where Ĵ is known: what the impulses add to the velocities of the bodies, whitened.
    pub states: Vec<f64>,
    /// The most of any part.
    pub iterations: usize,
    pub setup: Duration,
    pub elapsed: Duration,
    /// (iterations, residual) of the system or of its only part; of the whole in the end where there are several.
    pub history: Vec<(usize, f64)>,
    pub details: Details,
    /// What presolve did; None where it was not wanted, or found nothing to do.
    pub presolve: Option<presolve::Summary>,
}

/// What only one of the methods tells.
#[derive(Clone, Debug, Default)]
pub enum Details {
    /// There was nothing to solve.
    #[default]
    Nothing,
    Sweeps(Stop),
    Exact(Factored),
}

#[derive(Clone, Debug, Default)]
pub struct Factored {
    pub factorisations: usize,
    pub factor_time: Duration,
    pub fill: usize,
    pub fallbacks: Vec<&'static str>,
    pub infeasibility: Option<Vec<f64>>,
}

/// A stacked system by its numbers: A or Ĵ, B, and μ and d = max diag A_ii of each contact.
#[derive(Clone, Copy)]
pub struct System<'a> {
    pub form: Form,
    pub matrix: &'a BlockMatrix,
    pub b: &'a [f64],
    pub friction: &'a [f64],
    pub scale: &'a [f64],
    /// Where the bodies are rigid, which makes sweeps quicker.
    pub rigid: Option<Rigid<'a>>,
}

/// Who has a stacked system, with what presolve may read beside it.
pub trait Stacked {
    fn system(&self) -> System<'_>;

    /// The blocks of J in the places of those of Ĵ, see `presolve::View`.
    fn jacobian(&self) -> Option<&[f64]>;

    /// How the bodies move before the impulses; None where nobody knows, or nobody needs to.
    fn free_motion(&self) -> Option<Cow<'_, FreeMotion>>;

    /// As presolve reads it.
    fn view<'a>(
        &'a self,
        law: exact::Law,
        free: Option<&'a FreeMotion>,
        swept: bool,
    ) -> presolve::View<'a> {
        let System {
            form,
            matrix,
            b,
            friction,
            ..
        } = self.system();
        presolve::View {
            form,
            free,
            rows: matrix.height,
            width: matrix.width,
            bodies: matrix.block_columns,
            starts: &matrix.starts,
            columns: &matrix.columns,
            whitened: &matrix.values,
            jacobian: self.jacobian(),
            b,
            largest: exact::largest(b),
            friction,
            law,
            swept,
        }
    }
}

impl<'a> System<'a> {
    /// With d of each contact from `scale_of`.
    pub fn of(part: &'a Part, scale: &'a [f64]) -> Self {
        Self {
            form: part.form,
            matrix: &part.matrix,
            b: &part.b,
            friction: &part.friction,
            scale,
            rigid: None,
        }
    }

    fn operator(&self) -> Operator {
        match self.form {
            Form::Velocity => Operator::Velocity(self.matrix.clone()),
            Form::Impulse => Operator::Impulse(self.matrix.clone()),
        }
    }

    /// The states of bodies without impulses.
    fn at_rest(&self) -> Vec<f64> {
        match self.form {
            Form::Velocity => vec![0.0; self.matrix.block_columns * self.matrix.width],
            Form::Impulse => Vec::new(),
        }
    }

    /// ‖natural map‖/‖B‖ of impulses, rows per contact.
    pub fn residual(&self, program: &Program, impulse: &[f64]) -> f64 {
        let mut states = Vec::new();
        if let Form::Velocity = self.form {
            self.matrix.gather(impulse, &mut states);
        }
        let residual = self.residual_at(program, impulse, &states, f64::INFINITY);
        residual.unwrap_or(f64::INFINITY)
    }

    /// The states of an `Answer`.
    fn states_of(&self, impulse: &[f64]) -> Vec<f64> {
        let mut states = Vec::new();
        if let Form::Velocity = self.form {
            self.matrix.gather_compensated(impulse, &mut states);
        }
        states
    }

    /// ‖natural map‖² of contact k, (m/s)², where Ĵ is known, and Ĵᵀ p.
    fn squared_map(&self, program: &Program, k: usize, impulse: &[f64], states: &[f64]) -> f64 {
        debug_assert_eq!(self.form, Form::Velocity);
        let rows = self.matrix.height;
        let (at, mut velocity) = (rows * k..rows * (k + 1), [0.0; 3]);
        let velocity = &mut velocity[..rows];
        self.matrix
            .spread(k..k + 1, states, &self.b[at.clone()], velocity);
        program.squared_map_of(*self, k, &impulse[at], velocity)
    }

    /// What these contacts leave of ‖natural map‖², (m/s)², None where it is more than `most`; where Ĵ is known, and Ĵᵀ p.
    pub fn left_by(
        &self,
        program: &Program,
        contacts: &[u32],
        impulse: &[f64],
        states: &[f64],
        most: f64,
    ) -> Option<f64> {
        let mut left = 0.0;
        for &contact in contacts {
            left += self.squared_map(program, contact as usize, impulse, states);
            if left > most {
                break;
            }
        }
        // One that is no number is not.
        (left <= most).then_some(left)
    }

    /// What these contacts leave of it without impulses.
    fn left_without(&self, program: &Program, contacts: &[u32]) -> f64 {
        let rows = self.matrix.height;
        let squared_map = |&contact: &u32| {
            let k = contact as usize;
            let mut falling = [0.0; 3];
            for (u, b) in falling.iter_mut().zip(&self.b[rows * k..rows * (k + 1)]) {
                *u = -b;
            }
            program.squared_map_of(*self, k, &[0.0; 3][..rows], &falling[..rows])
        };
        contacts.iter().map(squared_map).sum()
    }

    /// ‖natural map‖/‖B‖ where the states, if Ĵ is known, are Ĵᵀ p; None where it is more than `most`.
    fn residual_at(
        &self,
        program: &Program,
        impulse: &[f64],
        states: &[f64],
        most: f64,
    ) -> Option<f64> {
        if let Form::Velocity = self.form {
            let velocity = |contacts, b: &[f64], velocity: &mut [f64]| {
                self.matrix.spread(contacts, states, b, velocity);
            };
            return program.relative_map(*self, impulse, velocity, most);
        }
        let mut product = vec![[0.0; 3]; self.friction.len()];
        self.matrix.times(impulse, &mut product);
        let velocity = |contacts: Range<usize>, b: &[f64], velocity: &mut [f64]| {
            let product = product[contacts]
                .iter()
                .flat_map(|u| &u[..self.matrix.height]);
            for ((velocity, u), b) in velocity.iter_mut().zip(product).zip(b) {
                *velocity = u - b;
            }
        };
        program.relative_map(*self, impulse, velocity, most)
    }
}

/// d = max diag A_ii of each contact.
pub fn scale_of(form: Form, matrix: &BlockMatrix) -> Vec<f64> {
    let diagonal = match form {
        Form::Velocity => matrix.squares_of_rows(),
        Form::Impulse => matrix.diagonal(),
    };
    let largest = |d: [f64; 3]| d.into_iter().fold(0.0, f64::max);
    diagonal.into_iter().map(largest).collect()
}

impl Stacked for Stack {
    fn system(&self) -> System<'_> {
        System {
            form: Form::Velocity,
            matrix: &self.whitened,
            b: &self.b,
            friction: &self.friction,
            scale: &self.scale,
            rigid: (self.layout.rows == 3 && self.layout.columns == 6).then_some(Rigid {
                jacobian: &self.blocks,
                masses: Masses::Roots(&self.roots),
            }),
        }
    }

    fn jacobian(&self) -> Option<&[f64]> {
        Some(&self.blocks)
    }

    fn free_motion(&self) -> Option<Cow<'_, FreeMotion>> {
        // Where no contact is apart, nobody asks.
        let largest = exact::largest(&self.b);
        if !presolve::any_apart(&self.b, self.layout.rows, largest) {
            return None;
        }
        let columns = self.layout.columns;
        let mut velocity = Vec::with_capacity(columns * self.free.len());
        for free in &self.free {
            velocity.extend_from_slice(&free.linear.to_array());
            if columns > 3 {
                velocity.extend_from_slice(&free.angular.to_array());
            }
        }
        let masses = self.roots.iter().map(|root| root.inverse_mass(columns));
        FreeMotion::of(velocity, columns, masses).map(Cow::Owned)
    }
}

/// What is left of a system for a solver outside the core, its parts `apart` or as one for each shape, and the tolerance
/// of each; None where nothing can be taken from it.
pub fn left_for_others(
    asked: &impl Stacked,
    law: exact::Law,
    tolerance: f64,
    apart: bool,
) -> Option<(Reduced, Vec<f64>)> {
    let free = asked.free_motion();
    let view = asked.view(law, free.as_deref(), false);
    let found = presolve::reduce(&view, 1, &|_| None, None);
    let Found::Reduced(mut reduced) = found else {
        return None;
    };
    if !apart {
        reduced.parts = presolve::together(reduced.parts);
    }
    let whole = presolve::size(view.b);
    let own = |part: &Part| tolerance_of(&view, part, whole, AIM * tolerance);
    let tolerances = reduced.parts.iter().map(own).collect();
    Some((reduced, tolerances))
}

/// Solve the system from the impulses `start`; None where the caller interrupts it.
///
/// Who solves one system after the other has what presolve remembers.
pub fn solve(
    asked: &impl Stacked,
    effort: &Effort,
    start: Option<&[f64]>,
    remembered: Option<&mut Remembered>,
    interrupted: Interrupted,
) -> Option<Answer> {
    let system = asked.system();
    if system.b.iter().all(|value| *value == 0.0) {
        return Some(Answer {
            impulse: vec![0.0; system.b.len()],
            states: system.at_rest(),
            ..Answer::default()
        });
    }
    let limits = Limits::new(
        AIM * effort.tolerance,
        effort.max_iterations,
        effort.time_limit,
        interrupted,
    );
    // At rest the impulses of the step before are the answer, and this is all that is done to them.
    let mut states = Vec::new();
    if let Some(start) = start {
        match kept(system, effort, &limits, start, Instant::now()) {
            Ok(answer) => return Some(answer),
            Err(found) => states = found,
        }
    }
    let lifted;
    let mut start = start;
    if effort.presolve
        && let Some(law) = effort.program.isotropic()
    {
        let begun = Instant::now();
        let swept = matches!(effort.method, Method::Sweeps { .. });
        let free = if swept { None } else { asked.free_motion() };
        let view = asked.view(law, free.as_deref(), swept);
        let whole = presolve::size(view.b);
        let rests = |island: &[u32]| {
            let start = start.filter(|_| system.form == Form::Velocity)?;
            let share = presolve::fair_share(&view, island, whole);
            let most = limits.tolerance * limits.tolerance * share;
            let left = system.left_by(&effort.program, island, start, &states, most)?;
            // Impulses that do nothing but hold each other are not kept.
            (left < system.left_without(&effort.program, island)).then_some(left)
        };
        let answer = match presolve::reduce(&view, effort.threads, &rests, remembered) {
            Found::Nothing => None,
            Found::Islands(islands) => {
                Some(by_islands(system, &view, &islands, effort, &limits, start)?)
            }
            Found::Reduced(reduced) => {
                Some(by_parts(&view, reduced, effort, &limits, start, false)?)
            }
        };
        if let Some(mut answer) = answer {
            answer.elapsed = begun.elapsed().saturating_sub(answer.setup);
            answer.measure(system, effort);
            let last_word = match effort.method {
                Method::Sweeps { .. } => answer.residual <= ROUNDED,
                Method::Exact(_) => false,
            };
            // Where parts are solved and the whole is not, at tolerances near rounding, the whole has the last word.
            if answer.status != Status::Solved || answer.residual <= effort.tolerance || last_word {
                return Some(judged(answer, effort));
            }
            lifted = answer.impulse;
            start = Some(&lifted);
        }
    }
    let mut answer = run(system, effort, &limits, start, effort.threads, None)?;
    answer.measure(system, effort);
    Some(judged(answer, effort))
}

impl Answer {
    fn measure(&mut self, system: System, effort: &Effort) {
        self.states = system.states_of(&self.impulse);
        let (program, impulse, states) = (&effort.program, &self.impulse, &self.states);
        let residual = system.residual_at(program, impulse, states, f64::INFINITY);
        self.residual = residual.unwrap_or(f64::INFINITY);
    }
}

/// Solved is what the residual says.
fn judged(mut answer: Answer, effort: &Effort) -> Answer {
    if answer.residual <= effort.tolerance {
        answer.status = Status::Solved;
    } else if answer.status == Status::Solved {
        answer.status = Status::Stalled;
    }
    answer
}

/// The start, or no impulses, where a few sweeps make that a solution.
fn nearly(system: System, effort: &Effort, limits: &Limits, start: &[f64]) -> Option<Answer> {
    let begun = Instant::now();
    let residual = system.residual(&effort.program, start);
    if residual > NEAR * limits.tolerance {
        return None;
    }
    let settings = Settings {
        tolerance: limits.tolerance,
        max_sweeps: FEW_SWEEPS,
        time_limit: limits.left(),
        relaxation: 1.0,
        acceleration: true,
        threads: 1,
    };
    let interrupted = &|| limits.interrupted();
    let program = &effort.program;
    let swept = sweep(system, program, &settings, Some(start), interrupted, None)?;
    kept(system, effort, limits, &swept.impulse, begun).ok()
}

/// Impulses that are a solution, or none if they do nothing but hold each other; else the states that they lead to.
fn kept(
    system: System,
    effort: &Effort,
    limits: &Limits,
    impulse: &[f64],
    begun: Instant,
) -> Result<Answer, Vec<f64>> {
    let (program, states) = (&effort.program, system.states_of(impulse));
    let residual = system.residual_at(program, impulse, &states, limits.tolerance);
    let Some(residual) = residual else {
        return Err(states);
    };
    let (impulse, residual, states) = match program.without(system, residual) {
        None => (impulse.to_vec(), residual, states),
        Some(without) => (vec![0.0; impulse.len()], without, system.at_rest()),
    };
    Ok(Answer {
        impulse,
        residual,
        states,
        elapsed: begun.elapsed(),
        history: vec![(0, residual)],
        details: effort.method.details(),
        ..Answer::default()
    })
}

/// Solve a system as it is; the residual of the answer is the method's own. Sweeps may be looked at.
pub fn run(
    system: System,
    effort: &Effort,
    limits: &Limits,
    start: Option<&[f64]>,
    threads: usize,
    look: Option<Look>,
) -> Option<Answer> {
    match effort.method {
        Method::Sweeps {
            relaxation,
            acceleration,
        } => {
            let settings = Settings {
                tolerance: limits.tolerance,
                max_sweeps: limits.iterations,
                time_limit: limits.left(),
                relaxation,
                acceleration,
                threads,
            };
            let interrupted = &|| limits.interrupted();
            sweep(system, &effort.program, &settings, start, interrupted, look)
        }
        Method::Exact(method) => {
            let law = effort.program.isotropic();
            let law = law.expect("no exact method solves polygons: refused when made");
            let near = start.and_then(|start| nearly(system, effort, limits, start));
            near.or_else(|| exactly(system, law, method, limits, start))
        }
    }
}

fn exactly(
    system: System,
    law: exact::Law,
    method: exact::Method,
    limits: &Limits,
    start: Option<&[f64]>,
) -> Option<Answer> {
    let begun = Instant::now();
    let problem = exact::Problem::new(system.operator(), system.b, system.friction, law)
        .expect("a system has as many entries of B and coefficients as contacts");
    let prepared = Instant::now();
    let report = exact::solve(&problem, method, limits, start);
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
        states: Vec::new(),
        iterations: report.iterations,
        setup: prepared - begun,
        elapsed: prepared.elapsed(),
        history: report.history,
        details: Details::Exact(Factored {
            factorisations: report.factorisations,
            factor_time: report.factor_time,
            fill: report.fill,
            fallbacks: report.fallbacks,
            infeasibility: report.infeasibility,
        }),
        presolve: None,
    })
}

/// Sweep over a system whose islands stay as they are, and when most of it is done, over what is not.
fn by_islands(
    system: System,
    view: &presolve::View,
    islands: &[Vec<u32>],
    effort: &Effort,
    limits: &Limits,
    start: Option<&[f64]>,
) -> Option<Answer> {
    let look = |impulse: &[f64]| !are_mostly_done(system, view, islands, effort, limits, impulse);
    let mut answer = run(system, effort, limits, start, effort.threads, Some(&look))?;
    answer.presolve = Some(presolve::unreduced(view, islands.len()));
    let ended = matches!(answer.details, Details::Sweeps(Stop::MaxSweeps));
    if !ended || answer.iterations == limits.iterations {
        return Some(answer);
    }
    let reduced = presolve::as_they_are(view, islands);
    let (before, mut rest) = (answer, *limits);
    rest.iterations -= before.iterations;
    answer = by_parts(view, reduced, effort, &rest, Some(&before.impulse), true)?;
    answer.iterations += before.iterations;
    answer.setup += before.setup;
    let after = answer.history.into_iter();
    answer.history = before.history;
    answer
        .history
        .extend(after.map(|(sweeps, residual)| (before.iterations + sweeps, residual)));
    Some(answer)
}

/// Solve what is left of a system, part by part, and lift what was found; the status is the worst of them.
fn by_parts(
    view: &presolve::View,
    reduced: Reduced,
    effort: &Effort,
    limits: &Limits,
    start: Option<&[f64]>,
    resumed: bool,
) -> Option<Answer> {
    let whole = presolve::size(view.b);
    let Reduced {
        mut impulse,
        resting,
        parts,
        summary,
        ..
    } = reduced;
    let answers = match effort.method {
        Method::Sweeps { .. } => {
            let budget = (limits.tolerance * whole).powi(2) - resting.leaves;
            swept(view, &parts, effort, limits, start, (budget, resumed))
        }
        Method::Exact(_) => solved(view, &parts, effort, limits, start),
    }?;
    if let Some(start) = start {
        for &contact in resting.islands.iter().flatten() {
            let at = contact as usize * view.rows;
            impulse[at..at + view.rows].copy_from_slice(&start[at..at + view.rows]);
        }
    }
    let mut answer = Answer {
        impulse,
        residual: resting.leaves.sqrt() / whole,
        details: effort.method.details(),
        presolve: Some(summary),
        ..Answer::default()
    };
    for (part, found) in parts.iter().zip(answers) {
        part.lift(view.rows, &found.impulse, &mut answer.impulse);
        let share = presolve::size(&part.b) / whole;
        answer.residual = answer.residual.hypot(found.residual * share);
        answer.iterations = answer.iterations.max(found.iterations);
        if parts.len() == 1 {
            (answer.setup, answer.history) = (found.setup, found.history);
        }
        match (&mut answer.details, found.details) {
            (Details::Sweeps(stop), Details::Sweeps(own)) if found.status > answer.status => {
                *stop = own;
            }
            (Details::Exact(all), Details::Exact(own)) => {
                let lift = |ray: &[f64], lifted: &mut [f64]| part.lift(view.rows, ray, lifted);
                all.add(own, view.b.len(), lift);
            }
            _ => {}
        }
        answer.status = answer.status.max(found.status);
    }
    if parts.len() > 1 {
        answer.history.push((answer.iterations, answer.residual));
    }
    Some(answer)
}

/// Solve each part by an exact method.
fn solved(
    view: &presolve::View,
    parts: &[Part],
    effort: &Effort,
    limits: &Limits,
    start: Option<&[f64]>,
) -> Option<Vec<Answer>> {
    let whole = presolve::size(view.b);
    let solve_part = |part: &Part, threads: usize| {
        let mut own = *limits;
        own.tolerance = tolerance_of(view, part, whole, limits.tolerance);
        let start = start.map(|start| part.restrict(view.rows, start));
        let scale = scale_of(part.form, &part.matrix);
        let system = System::of(part, &scale);
        run(system, effort, &own, start.as_deref(), threads, None)
    };
    let contacts = |part: &Part| part.friction.len();
    let answers = presolve::each(parts, contacts, effort.threads, false, &solve_part);
    answers.into_iter().collect()
}

/// What a part may leave, relative to its own B, where the whole may leave `tolerance` of ‖B‖ = `whole`.
fn tolerance_of(view: &presolve::View, part: &Part, whole: f64, tolerance: f64) -> f64 {
    let allowed = presolve::fair_share(view, &part.contacts, whole) / part.weight(view);
    (tolerance * allowed.sqrt()).max(FINEST)
}

impl Factored {
    /// Take in what was found for a part, whose impulses `lift` carries to the whole system.
    fn add(&mut self, part: Self, rows: usize, lift: impl Fn(&[f64], &mut [f64])) {
        self.factorisations += part.factorisations;
        self.factor_time += part.factor_time;
        self.fill += part.fill;
        for name in part.fallbacks {
            if !self.fallbacks.contains(&name) {
                self.fallbacks.push(name);
            }
        }
        if let Some(ray) = part.infeasibility {
            lift(
                &ray,
                self.infeasibility.get_or_insert_with(|| vec![0.0; rows]),
            );
        }
    }
}
