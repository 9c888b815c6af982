//! A world between two steps: who is there, where they are, what touches, and what is kept from one step to the next.

use std::mem::swap;
use std::sync::Arc;

use parry3d_f64::math::{Pose, Vector};

use crate::bodies::{Bodies, State, Twist};
use crate::collision::{Contact, Start, match_starts};
use crate::solving::{Interrupted, Status};
use crate::stacking::{Layout, Stack};
use crate::stepping::{Efforts, Failure, Solved, Workspace, found, moved, require_finite, step};
use crate::team::Team;

#[derive(Default)]
pub struct World {
    pub bodies: Arc<Bodies>,
    pub conditions: Conditions,
    /// How steps are solved that the core takes by itself.
    pub efforts: Option<Arc<Efforts>>,
    pub instant: Instant,
}

/// What holds until it is changed.
#[derive(Clone, Default)]
pub struct Conditions {
    pub time_step: f64,
    pub gravity: Vector,
    /// Closing speed above which elasticity acts, m/s.
    pub impact_speed: f64,
    /// On each moving body.
    pub forces: Vec<Twist>,
    pub layout: Layout,
    /// Whether a step starts from the impulses of the one before.
    pub warm_start: bool,
}

/// All that a step changes.
#[derive(Default)]
pub struct Instant {
    pub state: State,
    /// In the last step; None before the first.
    pub touching: Option<Arc<Touching>>,
    /// What the last step solved, if the core took it.
    pub solved: Option<Solved>,
    /// Taken so far, and how many of them ended above the tolerance.
    pub steps: usize,
    pub unsolved: usize,
}

/// The contacts of a step with their impulses, N s, zero in the rows that the step did not have.
#[derive(Clone, Default)]
pub struct Touching {
    pub contacts: Vec<Contact>,
    pub impulses: Vec<[f64; 3]>,
    /// Where the next step starts.
    pub starts: Vec<Start>,
    /// Of each contact, in the step.
    pub rows: usize,
    /// Of the step, s.
    pub time_step: f64,
}

impl Touching {
    /// Put where contacts of a step of this length start into `start`: forces last, impulses do not.
    pub fn start(
        &self,
        bodies: &Bodies,
        contacts: &[Contact],
        time_step: f64,
        start: &mut Vec<Start>,
    ) {
        match_starts(bodies, contacts, &self.contacts, &self.starts, start);
        if time_step != self.time_step {
            let ratio = time_step / self.time_step;
            for start in start {
                start.impulse.iter_mut().for_each(|value| *value *= ratio);
                start.kept = 0;
            }
        }
    }

    /// Take the impulses of the contacts in, rows per contact, which were found from `begun`.
    pub fn receive(&mut self, impulse: &[f64], rows: usize, time_step: f64, begun: &[Start]) {
        (self.rows, self.time_step) = (rows, time_step);
        let three = |p: &[f64]| std::array::from_fn(|r| p.get(r).copied().unwrap_or(0.0));
        self.impulses.clear();
        match rows {
            3 => self.impulses.extend_from_slice(impulse.as_chunks().0),
            _ => self.impulses.extend(impulse.chunks_exact(rows).map(three)),
        }
        self.starts.clear();
        if begun.is_empty() {
            let last = |&impulse| Start { impulse, kept: 0 };
            self.starts.extend(self.impulses.iter().map(last));
            return;
        }
        let next = |(impulse, start): (&[f64; 3], &Start)| start.after(*impulse);
        let steps = self.impulses.iter().zip(begun);
        self.starts.extend(steps.map(next));
    }

    /// Rename the bodies of the contacts; a contact of a body that is no longer there goes.
    fn rename(&mut self, name: impl Fn(u32) -> Option<u32>) {
        let numbers = self.impulses.drain(..).zip(self.starts.drain(..));
        let left = self.contacts.drain(..).zip(numbers);
        let left = left.filter_map(|(contact, numbers)| {
            let bodies = [name(contact.bodies[0])?, name(contact.bodies[1])?];
            Some((Contact { bodies, ..contact }, numbers))
        });
        (self.contacts, (self.impulses, self.starts)) = left.collect();
    }
}

impl Instant {
    /// Become what the next step starts from: the same but for `solved`.
    fn copy(&mut self, other: &Self) {
        self.state.poses.clone_from(&other.state.poses);
        self.state.velocities.clone_from(&other.state.velocities);
        self.touching.clone_from(&other.touching);
        (self.steps, self.unsolved) = (other.steps, other.unsolved);
    }

    /// Move on to what a step has left in the workspace.
    fn receive(&mut self, workspace: &mut Workspace, failed: bool) {
        swap(&mut self.state, &mut workspace.state);
        let touching = self.touching.get_or_insert_default();
        swap(touching, &mut workspace.touching);
        self.steps += 1;
        self.unsolved += usize::from(failed);
    }
}

impl World {
    /// Become the same world as another, as far as the next step goes; memory is used again.
    pub fn copy(&mut self, other: &Self) {
        self.bodies.clone_from(&other.bodies);
        self.conditions.clone_from(&other.conditions);
        self.efforts.clone_from(&other.efforts);
        self.instant.copy(&other.instant);
    }

    /// Take up to `count` steps; an error tells why the one after those taken was not.
    ///
    /// # Panics
    /// Where no efforts are set.
    pub fn take_steps(
        &mut self,
        count: usize,
        workspace: &mut Workspace,
        interrupted: Interrupted,
    ) -> Result<(), Failure> {
        let efforts = self.efforts.clone().expect("the core solves the steps");
        require_finite(self.conditions.forces.iter().map(Twist::is_finite))?;
        for _ in 0..count {
            step(self, &efforts, workspace, interrupted)?;
            let solved = self.instant.solved.get_or_insert_default();
            swap(solved, &mut workspace.solved);
            let failed = solved.answer.status != Status::Solved;
            self.instant.receive(workspace, failed);
            if interrupted() {
                return Err(Failure::Interrupted);
            }
        }
        Ok(())
    }

    /// The contacts that bodies may come to within the next step, moving at `free`.
    pub fn detect(
        &self,
        free: &[Twist],
        workspace: &mut Workspace,
    ) -> Result<Vec<Contact>, Failure> {
        let mut contacts = Vec::new();
        let memory = workspace.kept_pairs(&self.bodies);
        Team::with(1, |team| found(self, memory, free, &mut contacts, team))?;
        Ok(contacts)
    }

    /// End a step that was solved elsewhere; `failed` where above the tolerance.
    pub fn advance(
        &mut self,
        contacts: &[Contact],
        stack: &Stack,
        impulse: &[f64],
        failed: bool,
        workspace: &mut Workspace,
    ) -> Result<(), Failure> {
        let mut states = Vec::new();
        stack.whitened.gather_compensated(impulse, &mut states);
        moved(self, contacts, stack, &states, &mut workspace.state)?;
        let (time_step, mut start) = (self.conditions.time_step, Vec::new());
        let before = self.instant.touching.as_ref();
        if let Some(before) = before.filter(|_| self.conditions.warm_start) {
            before.start(&self.bodies, contacts, time_step, &mut start);
        }
        let touching = workspace.free_touching();
        touching.contacts = contacts.to_vec();
        touching.receive(impulse, stack.layout.rows, time_step, &start);
        self.instant.solved = None;
        self.instant.receive(workspace, failed);
        Ok(())
    }

    /// Let `bodies` live here, which are those before and one more: a moving one, here, if it has a pose and a velocity.
    pub fn add(&mut self, bodies: Arc<Bodies>, moving: Option<(Pose, Twist)>) {
        let row = self.bodies.moving as u32;
        self.bodies = bodies;
        let Some((pose, velocity)) = moving else {
            return;
        };
        self.instant.state.poses.push(pose);
        self.instant.state.velocities.push(velocity);
        if let Some(touching) = &mut self.instant.touching {
            Arc::make_mut(touching).rename(|body| Some(body + u32::from(body >= row)));
        }
    }

    /// Let `bodies` live here, which are those before without that of this number.
    pub fn remove(&mut self, bodies: Arc<Bodies>, number: usize) {
        if number < self.bodies.moving {
            self.instant.state.poses.remove(number);
            self.instant.state.velocities.remove(number);
        }
        self.bodies = bodies;
        let number = number as u32;
        if let Some(touching) = &mut self.instant.touching {
            let name = |body| (body != number).then(|| body - u32::from(body > number));
            Arc::make_mut(touching).rename(name);
        }
    }
}
