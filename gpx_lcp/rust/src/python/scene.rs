//! The stages of a step as Python calls them: free motion, detection, stacking, advance.

use std::panic::catch_unwind;
use std::sync::Mutex;

use numpy::PyArray2;
use parry3d_f64::math::{Matrix, Pose, Vector};
use pyo3::prelude::*;

use super::records::{
    Contacts, Floats, ProblemError, Stack, State, Table, pose, rows, same_length, table, twist,
    twist_row,
};
use crate::bodies::{Bodies as BodyData, CombineRule, Material, Twist, root};
use crate::collision;
use crate::collision::solid::{Convex, Solid};
use crate::integration;
use crate::stacking::{self, Layout, Motion, Stack as StackData};
use crate::stepping;

/// The bodies of a world: what does not change while it runs.
#[pyclass(frozen, module = "gpx_lcp._core")]
pub struct Bodies(pub BodyData);

#[pymethods]
impl Bodies {
    /// Shapes are pairs of a kind and its numbers: "none", "sphere" (radius), "half_space" (normal), "box" (half
    /// lengths), "capsule" and "cylinder" (radius, half length), "hull" (points).
    #[new]
    fn new(
        moving: usize,
        shapes: Vec<(String, Floats<'_>)>,
        materials: Vec<(f64, usize, [f64; 2], usize)>,
        masses: Floats<'_>,
        inertias: Table<'_>,
        fixed_poses: Table<'_>,
    ) -> PyResult<Self> {
        let solids = shapes
            .iter()
            .enumerate()
            .map(|(body, (kind, numbers))| solid(body, kind, numbers.as_slice()?))
            .collect::<PyResult<Vec<_>>>()?;
        let materials = materials
            .into_iter()
            .map(|(friction, friction_rule, elasticity, elasticity_rule)| {
                Ok(Material {
                    friction,
                    friction_rule: combine_rule(friction_rule)?,
                    elasticity,
                    elasticity_rule: combine_rule(elasticity_rule)?,
                })
            })
            .collect::<PyResult<Vec<_>>>()?;
        let masses = masses.as_slice()?.to_vec();
        let inertias: Vec<Matrix> = rows::<f64, 9>(&inertias)?
            .iter()
            .map(Matrix::from_cols_array)
            .collect();
        let fixed_poses: Vec<Pose> = rows::<f64, 7>(&fixed_poses)?.iter().map(pose).collect();
        same_length("masses", masses.len(), moving)?;
        same_length("inertias", inertias.len(), moving)?;
        same_length("materials", materials.len(), solids.len())?;
        same_length("shapes", solids.len(), moving + fixed_poses.len())?;
        let inverse = |tensor: &Matrix| {
            if *tensor == Matrix::ZERO {
                Matrix::ZERO
            } else {
                tensor.inverse()
            }
        };
        Ok(Bodies(BodyData {
            moving,
            solids,
            materials,
            inverse_inertia_roots: inertias
                .iter()
                .map(|tensor| root(&inverse(tensor)))
                .collect(),
            inverse_inertias: inertias.iter().map(inverse).collect(),
            masses,
            inertias,
            fixed_poses,
            broad_phase: Mutex::default(),
        }))
    }

    /// Velocities (moving, 6) after gravity, forces and gyroscopic moments, without contact.
    fn free_velocities<'py>(
        &self,
        py: Python<'py>,
        state: &State,
        forces: Table<'py>,
        gravity: [f64; 3],
        time_step: f64,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let forces = self.twists("forces", &forces)?;
        self.check_state(state)?;
        let free = py.detach(|| {
            integration::free_velocities(
                &self.0,
                &state.0.poses,
                &state.0.velocities,
                &forces,
                Vector::from_array(gravity),
                time_step,
            )
        });
        table(py, free.iter().flat_map(twist_row).collect(), 6)
    }

    /// The contacts that bodies may come to within the step.
    fn detect(
        &self,
        py: Python<'_>,
        state: &State,
        free_velocities: Table<'_>,
        time_step: f64,
    ) -> PyResult<Contacts> {
        let free = self.twists("free_velocities", &free_velocities)?;
        self.check_state(state)?;
        let found = py.detach(|| stepping::found(&self.0, &state.0.poses, &free, time_step));
        let contacts = found.map_err(|_| detection_failed())?;
        Ok(Contacts::new(&self.0, contacts))
    }

    /// Start impulses for `contacts` from the impulses of `previous` contacts, both (n, 3).
    fn match_impulses<'py>(
        &self,
        py: Python<'py>,
        contacts: &Contacts,
        previous: &Contacts,
        impulses: Table<'py>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let impulses = rows::<f64, 3>(&impulses)?;
        same_length("impulses", impulses.len(), previous.contacts.len())?;
        let (now, before) = (&contacts.contacts, &previous.contacts);
        let start = py.detach(|| collision::match_impulses(&self.0, now, before, &impulses));
        table(py, start.into_iter().flatten().collect(), 3)
    }

    /// The stacked system, with rows per contact and columns per body as asked.
    #[allow(clippy::too_many_arguments)]
    fn stack(
        &self,
        py: Python<'_>,
        state: &State,
        contacts: &Contacts,
        free_velocities: Table<'_>,
        time_step: f64,
        impact_speed: f64,
        rows: usize,
        columns: usize,
    ) -> PyResult<Stack> {
        let free = self.twists("free_velocities", &free_velocities)?;
        self.check_state(state)?;
        let layout = layout(rows, columns)?;
        let mut stack = StackData::default();
        py.detach(|| {
            let motion = Motion {
                poses: &state.0.poses,
                velocities: &state.0.velocities,
                free: &free,
                time_step,
                impact_speed,
            };
            stacking::stack(&self.0, &contacts.contacts, &motion, layout, &mut stack);
        });
        Ok(Stack(stack))
    }

    /// The state after the impulses, rows per contact.
    #[allow(clippy::too_many_arguments)]
    fn moved(
        &self,
        py: Python<'_>,
        state: &State,
        contacts: &Contacts,
        stack: &Stack,
        forces: Table<'_>,
        impulse: Floats<'_>,
        time_step: f64,
    ) -> PyResult<State> {
        let impulse = impulse.as_slice()?;
        self.check_state(state)?;
        same_length("stack", stack.0.contacts(), contacts.contacts.len())?;
        same_length("impulse", impulse.len(), stack.0.b.len())?;
        let forces = self.twists("forces", &forces)?;
        let (bodies, state, contacts) = (&self.0, &state.0, &contacts.contacts);
        let moved = py.detach(|| {
            stepping::moved(
                bodies, state, &forces, contacts, &stack.0, impulse, time_step,
            )
        });
        Ok(State(moved))
    }

    fn __repr__(&self) -> String {
        let (all, moving) = (self.0.len(), self.0.moving);
        format!("Bodies({moving} moving, {} fixed)", all - moving)
    }
}

impl Bodies {
    pub fn twists(&self, name: &str, table: &Table<'_>) -> PyResult<Vec<Twist>> {
        let twists = rows::<f64, 6>(table)?;
        same_length(name, twists.len(), self.0.moving)?;
        Ok(twists.iter().map(twist).collect())
    }

    pub fn check_state(&self, state: &State) -> PyResult<()> {
        same_length("state", state.0.poses.len(), self.0.moving)
    }
}

fn solid(body: usize, kind: &str, numbers: &[f64]) -> PyResult<Option<Solid>> {
    let convex = |convex| Ok(Some(Solid::Convex(convex)));
    match (kind, numbers) {
        ("none", []) => Ok(None),
        ("sphere", &[radius]) => Ok(Some(Solid::Sphere { radius })),
        ("half_space", &[x, y, z]) => Ok(Some(Solid::HalfSpace {
            normal: Vector::new(x, y, z),
        })),
        ("box", &[x, y, z]) => convex(Convex::cuboid(Vector::new(x, y, z))),
        ("capsule", &[radius, half_length]) => convex(Convex::capsule(radius, half_length)),
        ("cylinder", &[radius, half_length]) => convex(Convex::cylinder(radius, half_length)),
        ("hull", points) => {
            let points: Vec<Vector> = points.chunks_exact(3).map(Vector::from_slice).collect();
            let hull = catch_unwind(|| Convex::hull(&points)).unwrap_or(None);
            hull.map(|hull| Some(Solid::Convex(hull))).ok_or_else(|| {
                ProblemError::new_err(format!("the points of body {body} have no convex hull"))
            })
        }
        _ => Err(ProblemError::new_err(format!(
            "body {body} has a shape of kind {kind:?} with {} numbers, which does not exist",
            numbers.len()
        ))),
    }
}

fn combine_rule(index: usize) -> PyResult<CombineRule> {
    CombineRule::from_index(index)
        .ok_or_else(|| ProblemError::new_err(format!("there is no combine rule {index}")))
}

pub fn detection_failed() -> PyErr {
    ProblemError::new_err("collision detection failed: are shapes of extreme proportions?")
}

pub fn layout(rows: usize, columns: usize) -> PyResult<Layout> {
    if !matches!((rows, columns), (1 | 3, 3 | 6)) {
        return Err(ProblemError::new_err(format!(
            "{rows} rows and {columns} columns: a contact has 1 or 3 rows, a body 3 or 6 columns"
        )));
    }
    Ok(Layout { rows, columns })
}
