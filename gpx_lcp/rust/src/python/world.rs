//! Python's way to a world that the core keeps: what it is told, what it is asked, and its steps.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::{Duration, Instant};

use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use parry3d_f64::math::{Pose, Rotation, Vector};
use pyo3::prelude::*;

use super::records::{
    Contacts, Floats, ProblemError, Stack, Table, pose, rows, same_length, table, twist, twist_row,
};
use super::scene::Bodies;
use super::solved::{Settings, Solved};
use crate::bodies::{State, Twist};
use crate::collision::Start;
use crate::integration;
use crate::stacking::{self, Layout, Motion, Stack as StackData};
use crate::stepping::{Failure, Workspace};
use crate::team::Team;
use crate::world::{Touching, World as WorldData};

/// How often a call looks for signals.
const POLL_EVERY: Duration = Duration::from_millis(50);

/// A world between two steps.
///
/// Steps are worked out on a copy, which takes the place of the world when the call ends: it may be read meanwhile, from
/// other threads or where Python handles a signal. Nothing waits for Python while it holds `now`.
#[pyclass(frozen, module = "gpx_lcp._core")]
pub struct World {
    now: Mutex<WorldData>,
    taking: Mutex<Taking>,
}

/// The copy that steps are worked out on, and what else they are worked out in.
#[derive(Default)]
struct Taking {
    world: WorldData,
    workspace: Workspace,
}

#[pymethods]
impl World {
    /// An empty world.
    #[new]
    fn new(warm_start: bool) -> Self {
        let mut now = WorldData::default();
        now.conditions.warm_start = warm_start;
        Self {
            now: Mutex::new(now),
            taking: Mutex::default(),
        }
    }

    /// What holds during steps from now on: the length of a step, gravity, and the closing speed of impacts.
    fn set_conditions(&self, time_step: f64, gravity: [f64; 3], impact_speed: f64) {
        let conditions = &mut self.now().conditions;
        conditions.time_step = time_step;
        conditions.gravity = Vector::from_array(gravity);
        conditions.impact_speed = impact_speed;
    }

    /// How contacts are stacked, and solved if the core does that.
    fn configure(
        &self,
        rows: usize,
        columns: usize,
        settings: Option<Settings<'_>>,
    ) -> PyResult<()> {
        let layout = layout(rows, columns)?;
        let efforts = settings.map(|settings| settings.efforts()).transpose()?;
        let now = &mut *self.now();
        now.conditions.layout = layout;
        now.efforts = efforts.map(Arc::new);
        Ok(())
    }

    /// Let these bodies live here instead of any others: positions (moving, 3), orientations (moving, 4) as w, x, y, z,
    /// velocities (moving, 6). Nothing is known of what touches.
    fn populate(
        &self,
        bodies: &Bodies,
        positions: Table<'_>,
        orientations: Table<'_>,
        velocities: Table<'_>,
    ) -> PyResult<()> {
        let _idle = self.idle()?;
        let moving = bodies.0.moving;
        let state = State {
            poses: vec![Pose::IDENTITY; moving],
            velocities: vec![Twist::default(); moving],
        };
        let now = &mut *self.now();
        now.bodies = bodies.0.clone();
        now.instant = crate::world::Instant {
            state,
            ..Default::default()
        };
        put(
            &mut now.instant.state,
            0,
            Some(&positions),
            Some(&orientations),
            Some(&velocities),
        )
    }

    /// Let `bodies` live here, which are those before and one more: a moving one, if it has a position, an orientation and
    /// velocities, side by side.
    fn add(&self, bodies: &Bodies, moving: Option<Floats<'_>>) -> PyResult<()> {
        let _idle = self.idle()?;
        let moving = match &moving {
            Some(numbers) => {
                let numbers = numbers.as_slice()?;
                same_length("moving", numbers.len(), 13)?;
                let (place, velocity) = numbers.split_at(7);
                let velocities = twists("moving", velocity, 1)?;
                let place = std::array::from_fn(|k| place[k]);
                Some((pose(&place), velocities[0]))
            }
            None => None,
        };
        let now = &mut *self.now();
        let more = usize::from(moving.is_some());
        same_length("bodies", bodies.0.moving, now.bodies.moving + more)?;
        now.add(bodies.0.clone(), moving);
        Ok(())
    }

    /// Let `bodies` live here, which are those before without that of this number.
    fn remove(&self, bodies: &Bodies, number: usize) -> PyResult<()> {
        let _idle = self.idle()?;
        let now = &mut *self.now();
        let fewer = usize::from(number < now.bodies.moving);
        same_length("bodies", bodies.0.moving, now.bodies.moving - fewer)?;
        now.remove(bodies.0.clone(), number);
        Ok(())
    }

    /// Put the moving bodies from this row on somewhere else; what is not given stays.
    #[pyo3(signature = (row, positions, orientations, velocities))]
    fn place(
        &self,
        row: usize,
        positions: Option<Table<'_>>,
        orientations: Option<Table<'_>>,
        velocities: Option<Table<'_>>,
    ) -> PyResult<()> {
        let _idle = self.idle()?;
        let state = &mut self.now().instant.state;
        put(
            state,
            row,
            positions.as_ref(),
            orientations.as_ref(),
            velocities.as_ref(),
        )
    }

    /// Go on after so many steps, of which the last had this length, these contacts and their impulses, (n, 1 or 3), and
    /// left what `starts` tells.
    #[allow(clippy::too_many_arguments)]
    fn resume(
        &self,
        steps: usize,
        unsolved: usize,
        contacts: Option<&Contacts>,
        impulse: Table<'_>,
        time_step: f64,
        starts: Table<'_>,
        kept: PyReadonlyArray1<'_, u32>,
    ) -> PyResult<()> {
        let _idle = self.idle()?;
        let instant = &mut self.now().instant;
        (instant.steps, instant.unsolved, instant.solved) = (steps, unsolved, None);
        instant.touching = match contacts {
            None => None,
            Some(contacts) => {
                let mut touching = Touching::default();
                let contacts = &contacts.contacts;
                touching.contacts.clone_from(contacts);
                let rows = impulse.as_array().ncols();
                layout(rows, 6)?;
                same_length("impulse", impulse.as_slice()?.len(), contacts.len() * rows)?;
                touching.receive(impulse.as_slice()?, rows, time_step, &[]);
                let (starts, kept) = (starts.as_slice()?.as_chunks().0, kept.as_slice()?);
                same_length("starts", starts.len(), contacts.len())?;
                same_length("kept", kept.len(), contacts.len())?;
                let all = starts.iter().zip(kept);
                let start = |(&impulse, &kept)| Start { impulse, kept };
                touching.starts = all.map(start).collect();
                Some(Arc::new(touching))
            }
        };
        Ok(())
    }

    /// Take `count` steps under `forces`, (moving, 6).
    ///
    /// Whole steps count, whatever ends the call early. Returns the index of the body whose state is not finite after the
    /// next step, if that is what does; any other reason is raised.
    fn step(&self, py: Python<'_>, count: usize, forces: Table<'_>) -> PyResult<Option<usize>> {
        let forces = forces.as_slice()?;
        let signals = Signals::new();
        let taken = py.detach(|| {
            let mut taking = self.idle()?;
            let Taking { world, workspace } = &mut *taking;
            let before = {
                let now = self.now();
                world.copy(&now);
                now.instant.steps
            };
            if world.efforts.is_none() {
                return Err(ProblemError::new_err("no solver of the core is set"));
            }
            set_forces(world, forces)?;
            let result = world.take_steps(count, workspace, &|| signals.seen());
            if world.instant.steps > before {
                let now = &mut *self.now();
                std::mem::swap(&mut now.instant, &mut world.instant);
            }
            Ok(result)
        })?;
        match taken {
            Err(Failure::Interrupted) => signals.into_error().map_or(Ok(None), Err),
            other => failed(other),
        }
    }

    /// Velocities (moving, 6) after gravity, forces and gyroscopic moments, without contact.
    fn free_velocities<'py>(
        &self,
        py: Python<'py>,
        forces: Table<'py>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let now = &mut *self.now();
        set_forces(now, forces.as_slice()?)?;
        let (conditions, mut free) = (&now.conditions, Vec::new());
        integration::free_velocities(
            &now.bodies,
            &now.instant.state,
            &conditions.forces,
            conditions.gravity,
            conditions.time_step,
            &mut free,
        );
        table(py, free.iter().flat_map(twist_row).collect(), 6)
    }

    /// The contacts that bodies may come to within the next step.
    fn detect(&self, py: Python<'_>, free_velocities: Table<'_>) -> PyResult<Contacts> {
        let free = free_velocities.as_slice()?;
        py.detach(|| {
            let mut taking = self.idle()?;
            let now = self.now();
            let free = twists("free_velocities", free, now.bodies.moving)?;
            let found = now.detect(&free, &mut taking.workspace);
            let contacts = found.map_err(|_| detection_failed())?;
            Ok(Contacts::new(&now.bodies, contacts))
        })
    }

    /// The stacked system of these contacts.
    fn stack(&self, contacts: &Contacts, free_velocities: Table<'_>) -> PyResult<Stack> {
        let now = self.now();
        let free = free_velocities.as_slice()?;
        let free = twists("free_velocities", free, now.bodies.moving)?;
        let (conditions, state) = (&now.conditions, &now.instant.state);
        let motion = Motion {
            poses: &state.poses,
            velocities: &state.velocities,
            free: &free,
            time_step: conditions.time_step,
            impact_speed: conditions.impact_speed,
        };
        let mut stack = StackData::default();
        let layout = conditions.layout;
        Team::with(1, |team| {
            stacking::stack(
                &now.bodies,
                &contacts.contacts,
                &motion,
                layout,
                &mut stack,
                team,
            );
        });
        Ok(Stack(stack))
    }

    /// Start impulses for `contacts`, (n, 3), from those of the last step; None where there is none.
    fn start_impulses<'py>(
        &self,
        py: Python<'py>,
        contacts: &Contacts,
    ) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let now = self.now();
        let time_step = now.conditions.time_step;
        let start = now.instant.touching.as_ref().map(|before| {
            let mut start = Vec::new();
            before.start(&now.bodies, &contacts.contacts, time_step, &mut start);
            table(
                py,
                start.iter().flat_map(|start| start.impulse).collect(),
                3,
            )
        });
        start.transpose()
    }

    /// End a step that was solved elsewhere, with impulses (n, rows); `unsolved` where above the tolerance.
    ///
    /// Returns the index of the body whose state would not be finite, if there is one: the step is not taken then.
    fn advance(
        &self,
        contacts: &Contacts,
        stack: &Stack,
        impulse: Table<'_>,
        unsolved: bool,
    ) -> PyResult<Option<usize>> {
        let impulse = impulse.as_slice()?;
        same_length("stack", stack.0.contacts(), contacts.contacts.len())?;
        same_length("impulse", impulse.len(), stack.0.b.len())?;
        let mut taking = self.idle()?;
        let now = &mut *self.now();
        same_length("stack", stack.0.roots.len(), now.bodies.moving)?;
        let workspace = &mut taking.workspace;
        failed(now.advance(&contacts.contacts, &stack.0, impulse, unsolved, workspace))
    }

    /// How many steps were taken.
    #[getter]
    fn steps(&self) -> usize {
        self.now().instant.steps
    }

    /// How many of them ended above the tolerance.
    #[getter]
    fn unsolved(&self) -> usize {
        self.now().instant.unsolved
    }

    /// (moving, 3), m.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let now = self.now();
        let all = now.instant.state.poses.iter();
        table(py, all.flat_map(|p| p.translation.to_array()).collect(), 3)
    }

    /// (moving, 4): w, x, y, z.
    #[getter]
    fn orientations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let wxyz = |p: &Pose| [p.rotation.w, p.rotation.x, p.rotation.y, p.rotation.z];
        let now = self.now();
        let all = now.instant.state.poses.iter();
        table(py, all.flat_map(wxyz).collect(), 4)
    }

    /// (moving, 6): linear, then angular.
    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let now = self.now();
        let all = now.instant.state.velocities.iter();
        table(py, all.flat_map(twist_row).collect(), 6)
    }

    /// The contacts of the last step; None before the first.
    #[getter]
    fn contacts(&self) -> Option<Contacts> {
        let now = self.now();
        let touching = now.instant.touching.as_ref()?;
        Some(Contacts::new(&now.bodies, touching.contacts.clone()))
    }

    /// The impulses of `contacts`, with as many rows as the step had, N s; and the length of that step, s. Three rows are
    /// enough for all.
    #[pyo3(signature = (rows=None))]
    fn impulse<'py>(
        &self,
        py: Python<'py>,
        rows: Option<usize>,
    ) -> PyResult<Option<(Bound<'py, PyArray2<f64>>, f64)>> {
        let now = self.now();
        let Some(touching) = &now.instant.touching else {
            return Ok(None);
        };
        let rows = rows.unwrap_or(touching.rows);
        let all = touching.impulses.iter().flat_map(|p| &p[..rows]);
        let numbers = table(py, all.copied().collect(), rows)?;
        Ok(Some((numbers, touching.time_step)))
    }

    /// Where contacts start the next step, (n, 3), N s, and how many steps each has kept its impulse, (n,).
    #[allow(clippy::type_complexity)]
    fn starts<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<Option<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<u32>>)>> {
        let now = self.now();
        let Some(touching) = &now.instant.touching else {
            return Ok(None);
        };
        let starts = touching.starts.iter();
        let impulses = starts.clone().flat_map(|start| start.impulse).collect();
        let kept = PyArray1::from_iter(py, starts.map(|start| start.kept));
        Ok(Some((table(py, impulses, 3)?, kept)))
    }

    /// What the last step solved; None where the core did not take it.
    #[getter]
    fn solved(&self, py: Python<'_>) -> PyResult<Option<Solved>> {
        let solved = self.now().instant.solved.clone();
        solved.map(|solved| Solved::new(py, solved)).transpose()
    }

    fn __repr__(&self) -> String {
        let now = self.now();
        format!(
            "World({} moving bodies, {} steps)",
            now.bodies.moving, now.instant.steps
        )
    }
}

impl World {
    fn now(&self) -> MutexGuard<'_, WorldData> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What steps are worked out in, if no steps are being taken: a world does not change beneath them.
    fn idle(&self) -> PyResult<MutexGuard<'_, Taking>> {
        match self.taking.try_lock() {
            Ok(taking) => Ok(taking),
            Err(TryLockError::Poisoned(poisoned)) => Ok(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => Err(ProblemError::new_err(
                "the world is taking steps in another call: it can be read meanwhile, and changed afterwards",
            )),
        }
    }
}

/// The rows of a table from this row on take the place of what a state has there.
fn put(
    state: &mut State,
    row: usize,
    positions: Option<&Table<'_>>,
    orientations: Option<&Table<'_>>,
    velocities: Option<&Table<'_>>,
) -> PyResult<()> {
    let space = state.poses.len().saturating_sub(row);
    let fits = |name: &str, table: Option<&Table<'_>>| match table {
        Some(table) if table.as_array().nrows() > space => {
            same_length(name, table.as_array().nrows(), space)
        }
        _ => Ok(()),
    };
    fits("positions", positions)?;
    fits("orientations", orientations)?;
    fits("velocities", velocities)?;
    let positions = positions.map(rows::<f64, 3>).transpose()?;
    let orientations = orientations.map(rows::<f64, 4>).transpose()?;
    let velocities = velocities.map(rows::<f64, 6>).transpose()?;
    let poses = &mut state.poses[row..];
    for (pose, position) in poses.iter_mut().zip(positions.iter().flatten()) {
        pose.translation = Vector::from_array(*position);
    }
    for (pose, [w, i, j, k]) in poses.iter_mut().zip(orientations.iter().flatten()) {
        pose.rotation = Rotation::from_xyzw(*i, *j, *k, *w);
    }
    let twists = state.velocities[row..].iter_mut();
    for (velocity, numbers) in twists.zip(velocities.iter().flatten()) {
        *velocity = twist(numbers);
    }
    Ok(())
}

fn set_forces(world: &mut WorldData, forces: &[f64]) -> PyResult<()> {
    same_length("forces", forces.len(), 6 * world.bodies.moving)?;
    let held = &mut world.conditions.forces;
    held.clear();
    held.extend(forces.as_chunks::<6>().0.iter().map(twist));
    Ok(())
}

fn twists(name: &str, numbers: &[f64], moving: usize) -> PyResult<Vec<Twist>> {
    same_length(name, numbers.len(), 6 * moving)?;
    Ok(numbers.as_chunks::<6>().0.iter().map(twist).collect())
}

fn layout(rows: usize, columns: usize) -> PyResult<Layout> {
    if !matches!((rows, columns), (1 | 3, 3 | 6)) {
        return Err(ProblemError::new_err(format!(
            "{rows} rows and {columns} columns: a contact has 1 or 3 rows, a body 3 or 6 columns"
        )));
    }
    Ok(Layout { rows, columns })
}

/// The body whose state is not finite, or another reason why a step was not taken.
fn failed(taken: Result<(), Failure>) -> PyResult<Option<usize>> {
    match taken {
        Ok(()) | Err(Failure::Interrupted) => Ok(None),
        Err(Failure::NotFinite(body)) => Ok(Some(body)),
        Err(Failure::Detection) => Err(detection_failed()),
    }
}

fn detection_failed() -> PyErr {
    ProblemError::new_err("collision detection failed: are shapes of extreme proportions?")
}

/// Python's signals, looked for every 50 ms; the first one is kept.
struct Signals(Mutex<(Instant, Option<PyErr>)>);

impl Signals {
    fn new() -> Self {
        Self(Mutex::new((Instant::now(), None)))
    }

    fn seen(&self) -> bool {
        let mut watch = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (polled, signal) = &mut *watch;
        if signal.is_none() && polled.elapsed() >= POLL_EVERY {
            *polled = Instant::now();
            *signal = Python::attach(|py| py.check_signals()).err();
        }
        signal.is_some()
    }

    fn into_error(self) -> Option<PyErr> {
        let watch = self.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        watch.1
    }
}
