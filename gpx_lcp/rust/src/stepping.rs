//! A time step: its stages in sequence, for the methods that the core has of its own.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Weak};

use crate::bodies::{Bodies, State, Twist};
use crate::collision::{Contact, Memory, Start, detect};
use crate::correction::position_shift;
use crate::integration::{advance, free_velocities};
use crate::mean_motion::mean_motion;
use crate::presolve::Remembered;
use crate::solving::{Answer, Effort, Interrupted, solve};
use crate::stacking::{Motion, Stack, stack};
use crate::team::Team;
use crate::world::{Conditions, Touching, World};

/// Bodies of each thread that finds and stacks contacts, at least: a thread takes as long to start as they take.
const WORTH_A_THREAD: usize = 128;

/// How a step is solved whose contacts have friction, and one whose contacts have none.
#[derive(Clone)]
pub struct Efforts {
    pub with_friction: Effort,
    pub without_friction: Effort,
}

/// The system that a step solved, and the answer.
#[derive(Clone, Default)]
pub struct Solved {
    pub stack: Stack,
    pub answer: Answer,
    /// How far the start impulses had to be moved into their cones, where there were any.
    pub start_moved: Option<f64>,
}

/// What a step leaves, and what it is worked out in. Memory is used again; what is remembered saves time, and changes no
/// result.
#[derive(Default)]
pub struct Workspace {
    pub state: State,
    pub touching: Arc<Touching>,
    pub solved: Solved,
    detection: Memory,
    remembered: Remembered,
    /// Whose pairs detection keeps.
    bodies: Weak<Bodies>,
    free: Vec<Twist>,
    /// Where its contacts start, and those of the rows that the step has.
    matched: Vec<Start>,
    start: Vec<f64>,
}

impl Workspace {
    /// Where the contacts of the next step go: nobody else looks at them.
    pub fn free_touching(&mut self) -> &mut Touching {
        if Arc::get_mut(&mut self.touching).is_none() {
            self.touching = Arc::default();
        }
        Arc::get_mut(&mut self.touching).expect("it is this workspace's alone")
    }

    /// The pairs that were near each other, if they were pairs of these bodies.
    pub fn kept_pairs(&mut self, bodies: &Arc<Bodies>) -> &mut Memory {
        if !std::ptr::eq(self.bodies.as_ptr(), Arc::as_ptr(bodies)) {
            (self.bodies, self.detection) = (Arc::downgrade(bodies), Memory::default());
        }
        &mut self.detection
    }
}

/// Why a step was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// The state of this body is no longer finite.
    NotFinite(usize),
    Detection,
    Interrupted,
}

impl Efforts {
    /// Of the stages of a step.
    fn threads(&self) -> usize {
        self.with_friction.threads
    }

    fn of(&self, stack: &Stack) -> &Effort {
        if stack.has_friction() {
            &self.with_friction
        } else {
            &self.without_friction
        }
    }
}

/// Work one step of a world out, and leave it in the workspace.
pub fn step(
    world: &World,
    efforts: &Efforts,
    workspace: &mut Workspace,
    interrupted: Interrupted,
) -> Result<(), Failure> {
    let World {
        bodies,
        conditions,
        instant,
        ..
    } = world;
    let State { poses, velocities } = &instant.state;
    let Conditions {
        forces, gravity, ..
    } = conditions;
    let (time_step, rows) = (conditions.time_step, conditions.layout.rows);
    workspace.kept_pairs(bodies);
    workspace.free_touching();
    let Workspace {
        touching,
        solved,
        detection,
        remembered,
        free,
        matched,
        start,
        ..
    } = workspace;
    free_velocities(bodies, &instant.state, forces, *gravity, time_step, free);
    require_finite(free.iter().map(Twist::is_finite))?;
    let touching = Arc::get_mut(touching).expect("it is this workspace's alone");
    let contacts = &mut touching.contacts;
    let system = &mut solved.stack;
    let motion = Motion {
        poses,
        velocities,
        free,
        time_step,
        impact_speed: conditions.impact_speed,
    };
    let threads = Team::worth(efforts.threads(), bodies.moving, WORTH_A_THREAD);
    Team::with(threads, |team| {
        found(world, detection, free, contacts, team)?;
        stack(bodies, contacts, &motion, conditions.layout, system, team);
        Ok(())
    })?;
    let effort = efforts.of(system);
    let before = instant.touching.as_ref().filter(|_| conditions.warm_start);
    matched.clear();
    if let Some(before) = before {
        before.start(bodies, contacts, time_step, matched);
        start.clear();
        start.extend(matched.iter().flat_map(|start| &start.impulse[..rows]));
    }
    solved.start_moved = before.map(|_| effort.program.admit(&system.friction, start, rows));
    let start = before.map(|_| start.as_slice());
    solved.answer =
        solve(system, effort, start, Some(remembered), interrupted).ok_or(Failure::Interrupted)?;
    let Answer {
        impulse, states, ..
    } = &solved.answer;
    moved(world, contacts, system, states, &mut workspace.state)?;
    touching.receive(impulse, rows, time_step, matched);
    Ok(())
}

/// The contacts, or a failure where the collision library gives up: a panic in it must not cross the border.
pub fn found(
    world: &World,
    memory: &mut Memory,
    free: &[Twist],
    contacts: &mut Vec<Contact>,
    team: &Team,
) -> Result<(), Failure> {
    let (poses, time_step) = (&world.instant.state.poses, world.conditions.time_step);
    catch_unwind(AssertUnwindSafe(|| {
        let bodies = &world.bodies;
        detect(bodies, memory, poses, free, time_step, contacts, team);
    }))
    .map_err(|_| Failure::Detection)
}

/// The state after the impulses p, from Ĵᵀ p: velocities first, then poses by them and by what takes out overlap.
pub fn moved(
    world: &World,
    contacts: &[Contact],
    stack: &Stack,
    states: &[f64],
    next: &mut State,
) -> Result<(), Failure> {
    let World {
        bodies, instant, ..
    } = world;
    let state = &instant.state;
    let Conditions {
        forces, time_step, ..
    } = &world.conditions;
    stack.unwhitened(states, &mut next.velocities);
    for (velocity, free) in next.velocities.iter_mut().zip(&stack.free) {
        *velocity += *free;
    }
    let (poses, free, after) = (&state.poses, &stack.free, &next.velocities);
    let mut motion = mean_motion(bodies, contacts, state, forces, free, after, *time_step);
    let shift = position_shift(bodies, contacts, stack, poses, &motion, *time_step);
    for (velocity, shift) in motion.iter_mut().zip(shift.iter().flatten()) {
        *velocity += *shift;
    }
    advance(poses, &motion, *time_step, &mut next.poses);
    let finite = next.poses.iter().zip(&next.velocities);
    require_finite(finite.map(|(pose, velocity)| pose.is_finite() && velocity.is_finite()))
}

pub fn require_finite(finite: impl Iterator<Item = bool>) -> Result<(), Failure> {
    match finite.enumerate().find(|(_, finite)| !finite) {
        None => Ok(()),
        Some((body, _)) => Err(Failure::NotFinite(body)),
    }
}
