//! A time step: its stages in sequence, for the methods that the core has of its own.

use std::panic::{AssertUnwindSafe, catch_unwind};

use parry3d_f64::math::{Pose, Vector};

use crate::bodies::{Bodies, State, Twist};
use crate::collision::{Contact, detect, match_impulses};
use crate::correction::position_shift;
use crate::integration::{advance, free_velocities};
use crate::mean_motion::mean_motion;
use crate::solving::{Answer, Effort, Interrupted, solve};
use crate::stacking::{Layout, Motion, Stack, stack};

/// What holds during all steps of one call.
pub struct Conditions {
    pub time_step: f64,
    pub gravity: Vector,
    /// Closing speed above which elasticity acts, m/s.
    pub impact_speed: f64,
    pub forces: Vec<Twist>,
    pub layout: Layout,
    /// How a step is solved whose contacts have friction, and one whose contacts have none.
    pub with_friction: Effort,
    pub without_friction: Effort,
    /// Whether a step starts from the impulses of the one before.
    pub warm_start: bool,
}

/// What a step leaves, and what it has solved.
#[derive(Clone, Default)]
pub struct Step {
    /// At the end.
    pub state: State,
    /// The rest at its start.
    pub contacts: Vec<Contact>,
    pub stack: Stack,
    pub answer: Answer,
    /// How far the start impulses had to be moved into their cones, where there were any.
    pub start_moved: Option<f64>,
}

/// Why a step was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// The state of this body is no longer finite.
    NotFinite(usize),
    Detection,
    Interrupted,
}

impl Conditions {
    /// How the contacts of a step are solved.
    pub fn effort(&self, stack: &Stack) -> &Effort {
        if stack.has_friction() {
            &self.with_friction
        } else {
            &self.without_friction
        }
    }
}

/// Contacts with their impulses, rows per contact: where a warm start comes from.
pub struct Loads<'a> {
    pub contacts: &'a [Contact],
    pub impulse: &'a [f64],
}

/// Take one step from `state` and leave it in `step`, whose memory is used again.
pub fn step(
    bodies: &Bodies,
    conditions: &Conditions,
    state: &State,
    loads: Option<Loads>,
    step: &mut Step,
    interrupted: Interrupted,
) -> Result<(), Failure> {
    let State { poses, velocities } = state;
    let (time_step, gravity) = (conditions.time_step, conditions.gravity);
    let free = free_velocities(
        bodies,
        poses,
        velocities,
        &conditions.forces,
        gravity,
        time_step,
    );
    require_finite(free.iter().map(Twist::is_finite))?;
    step.contacts = found(bodies, poses, &free, time_step)?;
    let motion = Motion {
        poses,
        velocities,
        free: &free,
        time_step,
        impact_speed: conditions.impact_speed,
    };
    stack(
        bodies,
        &step.contacts,
        &motion,
        conditions.layout,
        &mut step.stack,
    );
    let effort = conditions.effort(&step.stack);
    let rows = conditions.layout.rows;
    let mut start = loads.filter(|_| conditions.warm_start).map(|loads| {
        let impulses: Vec<[f64; 3]> = loads.impulse.chunks_exact(rows).map(three_rows).collect();
        let matched = match_impulses(bodies, &step.contacts, loads.contacts, &impulses);
        matched
            .iter()
            .flat_map(|p| &p[..rows])
            .copied()
            .collect::<Vec<f64>>()
    });
    let friction = &step.stack.friction;
    step.start_moved = start
        .as_mut()
        .map(|start| effort.program.admit(friction, start, rows));
    let answer = solve(&step.stack, effort, start.as_deref(), interrupted);
    step.answer = answer.ok_or(Failure::Interrupted)?;
    let impulse = &step.answer.impulse;
    step.state = moved(
        bodies,
        state,
        &conditions.forces,
        &step.contacts,
        &step.stack,
        impulse,
        time_step,
    );
    let State { poses, velocities } = &step.state;
    let finite = poses.iter().zip(velocities);
    require_finite(finite.map(|(pose, velocity)| pose.is_finite() && velocity.is_finite()))
}

/// The contacts, or a failure where the collision library gives up: a panic in it must not cross the border.
pub fn found(
    bodies: &Bodies,
    poses: &[Pose],
    free: &[Twist],
    time_step: f64,
) -> Result<Vec<Contact>, Failure> {
    catch_unwind(AssertUnwindSafe(|| detect(bodies, poses, free, time_step)))
        .map_err(|_| Failure::Detection)
}

/// The state after the impulses, rows per contact: velocities first, then poses by them and by what takes out overlap.
pub fn moved(
    bodies: &Bodies,
    state: &State,
    forces: &[Twist],
    contacts: &[Contact],
    stack: &Stack,
    impulse: &[f64],
    time_step: f64,
) -> State {
    let mut velocities = stack.velocity_change(impulse);
    for (velocity, free) in velocities.iter_mut().zip(&stack.free) {
        *velocity += *free;
    }
    let (poses, free) = (&state.poses, &stack.free);
    let mut motion = mean_motion(
        bodies,
        contacts,
        state,
        forces,
        free,
        &velocities,
        time_step,
    );
    let shift = position_shift(bodies, contacts, stack, poses, &motion, time_step);
    for (velocity, shift) in motion.iter_mut().zip(shift.iter().flatten()) {
        *velocity += *shift;
    }
    State {
        poses: advance(poses, &motion, time_step),
        velocities,
    }
}

fn three_rows(p: &[f64]) -> [f64; 3] {
    std::array::from_fn(|r| p.get(r).copied().unwrap_or(0.0))
}

fn require_finite(finite: impl Iterator<Item = bool>) -> Result<(), Failure> {
    match finite.enumerate().find(|(_, finite)| !finite) {
        None => Ok(()),
        Some((body, _)) => Err(Failure::NotFinite(body)),
    }
}
