//! The stages of a step as Python calls them: free motion, detection, stacking, advance.

use std::panic::{AssertUnwindSafe, catch_unwind};

use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use parry3d_f64::math::{Matrix, Pose, Rotation, Vector};
use pyo3::prelude::*;

use crate::bodies::{Bodies as BodyData, CombineRule, Material, Twist};
use crate::collision::solid::{Convex, Solid};
use crate::collision::{self, Contact};
use crate::integration;
use crate::stacking::{self, Layout, Motion};

pyo3::import_exception!(gpx_lcp.errors, ProblemError);

type Floats<'py> = PyReadonlyArray1<'py, f64>;
type Table<'py> = PyReadonlyArray2<'py, f64>;

/// The bodies of a world: what does not change while it runs.
#[pyclass(frozen, module = "gpx_lcp._core")]
pub struct Bodies(BodyData);

/// Poses and velocities of the moving bodies at one instant.
#[pyclass(frozen, module = "gpx_lcp._core")]
pub struct State {
    poses: Vec<Pose>,
    velocities: Vec<Twist>,
}

/// The contacts of one state.
#[pyclass(frozen, module = "gpx_lcp._core")]
pub struct Contacts {
    contacts: Vec<Contact>,
    /// Bodies from this index on never move.
    moving: usize,
    friction: Vec<f64>,
    sizes: Vec<f64>,
}

#[pymethods]
impl Bodies {
    /// Shapes are pairs of a kind and its numbers: "none", "sphere" (radius), "half_space" (normal), "box" (half
    /// lengths), "capsule" and "cylinder" (radius, half length), "hull" (points).
    #[new]
    fn new(
        moving: usize,
        shapes: Vec<(String, Floats<'_>)>,
        materials: Vec<(f64, usize, f64, usize)>,
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
        let inertias: Vec<Matrix> = rows::<9>(&inertias)?
            .iter()
            .map(Matrix::from_cols_array)
            .collect();
        let fixed_poses: Vec<Pose> = rows::<7>(&fixed_poses)?.iter().map(pose).collect();
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
            inverse_inertias: inertias.iter().map(inverse).collect(),
            masses,
            inertias,
            fixed_poses,
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
                &state.poses,
                &state.velocities,
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
        let found = py.detach(|| {
            // A panic inside the collision library must not cross the border as one.
            catch_unwind(AssertUnwindSafe(|| {
                collision::detect(&self.0, &state.poses, &free, time_step)
            }))
        });
        let contacts = found.map_err(|_| {
            ProblemError::new_err("collision detection failed: are shapes of extreme proportions?")
        })?;
        Ok(Contacts {
            friction: contacts.iter().map(|c| self.0.friction(c.bodies)).collect(),
            sizes: contacts.iter().map(|c| self.0.size(c.bodies)).collect(),
            contacts,
            moving: self.0.moving,
        })
    }

    /// Start impulses for `contacts` from the impulses of `previous` contacts, both (n, 3).
    fn match_impulses<'py>(
        &self,
        py: Python<'py>,
        contacts: &Contacts,
        previous: &Contacts,
        impulses: Table<'py>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let impulses = rows::<3>(&impulses)?;
        same_length("impulses", impulses.len(), previous.contacts.len())?;
        let (now, before) = (&contacts.contacts, &previous.contacts);
        let start = py.detach(|| collision::match_impulses(&self.0, now, before, &impulses));
        table(py, start.into_iter().flatten().collect(), 3)
    }

    /// J as (row_starts, columns, blocks) and B, rows per contact and columns per body as asked.
    #[allow(clippy::type_complexity, clippy::too_many_arguments)]
    fn stack<'py>(
        &self,
        py: Python<'py>,
        state: &State,
        contacts: &Contacts,
        free_velocities: Table<'py>,
        time_step: f64,
        gravity: f64,
        rows: usize,
        columns: usize,
    ) -> PyResult<(
        Bound<'py, PyArray1<i32>>,
        Bound<'py, PyArray1<i32>>,
        Bound<'py, PyArray3<f64>>,
        Bound<'py, PyArray1<f64>>,
    )> {
        let free = self.twists("free_velocities", &free_velocities)?;
        self.check_state(state)?;
        let layout = layout(rows, columns)?;
        let stack = py.detach(|| {
            let motion = Motion {
                poses: &state.poses,
                velocities: &state.velocities,
                free: &free,
                time_step,
                gravity,
            };
            stacking::stack(&self.0, &contacts.contacts, &motion, layout)
        });
        let blocks = stack.columns.len();
        Ok((
            PyArray1::from_vec(py, stack.row_starts),
            PyArray1::from_vec(py, stack.columns),
            PyArray1::from_vec(py, stack.blocks).reshape([blocks, rows, columns])?,
            PyArray1::from_vec(py, stack.b),
        ))
    }

    /// M⁻¹ as (moving, columns, columns) blocks.
    fn inverse_mass<'py>(
        &self,
        py: Python<'py>,
        state: &State,
        columns: usize,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        self.check_state(state)?;
        layout(1, columns)?;
        let blocks = py.detach(|| stacking::inverse_mass(&self.0, &state.poses, columns));
        PyArray1::from_vec(py, blocks).reshape([self.0.moving, columns, columns])
    }

    fn __repr__(&self) -> String {
        let (all, moving) = (self.0.len(), self.0.moving);
        format!("Bodies({moving} moving, {} fixed)", all - moving)
    }
}

impl Bodies {
    fn twists(&self, name: &str, table: &Table<'_>) -> PyResult<Vec<Twist>> {
        let twists = rows::<6>(table)?;
        same_length(name, twists.len(), self.0.moving)?;
        Ok(twists.iter().map(twist).collect())
    }

    fn check_state(&self, state: &State) -> PyResult<()> {
        same_length("state", state.poses.len(), self.0.moving)
    }
}

#[pymethods]
impl State {
    /// positions (moving, 3), orientations (moving, 4) as w, x, y, z, velocities (moving, 6).
    #[new]
    fn new(positions: Table<'_>, orientations: Table<'_>, velocities: Table<'_>) -> PyResult<Self> {
        let positions = rows::<3>(&positions)?;
        let orientations = rows::<4>(&orientations)?;
        let velocities = rows::<6>(&velocities)?;
        same_length("orientations", orientations.len(), positions.len())?;
        same_length("velocities", velocities.len(), positions.len())?;
        let both = positions.iter().zip(&orientations);
        Ok(State {
            poses: both
                .map(|([x, y, z], [w, i, j, k])| pose(&[*x, *y, *z, *w, *i, *j, *k]))
                .collect(),
            velocities: velocities.iter().map(twist).collect(),
        })
    }

    /// The state after `time_step` at constant `pose_velocities`, carrying `velocities`.
    fn advanced(
        &self,
        py: Python<'_>,
        velocities: Table<'_>,
        pose_velocities: Table<'_>,
        time_step: f64,
    ) -> PyResult<State> {
        let velocities: Vec<Twist> = rows::<6>(&velocities)?.iter().map(twist).collect();
        let moving: Vec<Twist> = rows::<6>(&pose_velocities)?.iter().map(twist).collect();
        same_length("velocities", velocities.len(), self.poses.len())?;
        same_length("pose_velocities", moving.len(), self.poses.len())?;
        let poses = py.detach(|| integration::advance(&self.poses, &moving, time_step));
        Ok(State { poses, velocities })
    }

    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let all = self.poses.iter().flat_map(|p| p.translation.to_array());
        table(py, all.collect(), 3)
    }

    #[getter]
    fn orientations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let wxyz = |p: &Pose| [p.rotation.w, p.rotation.x, p.rotation.y, p.rotation.z];
        table(py, self.poses.iter().flat_map(wxyz).collect(), 4)
    }

    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, self.velocities.iter().flat_map(twist_row).collect(), 6)
    }
}

#[pymethods]
impl Contacts {
    fn __len__(&self) -> usize {
        self.contacts.len()
    }

    /// Body a of each contact, -1 where it never moves.
    #[getter]
    fn body_a<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.bodies(py, 0)
    }

    /// Body b of each contact, -1 where it never moves.
    #[getter]
    fn body_b<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.bodies(py, 1)
    }

    /// (n, 2): what touches on a and on b.
    #[getter]
    fn features<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let all = self.contacts.iter().flat_map(|c| c.features).collect();
        PyArray1::from_vec(py, all).reshape([self.contacts.len(), 2])
    }

    /// (n, 3), m.
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let all = self.contacts.iter().flat_map(|c| c.point.to_array());
        table(py, all.collect(), 3)
    }

    /// (n, 3, 3): normal from a to b, then the tangents.
    #[getter]
    fn frames<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let rows = self.contacts.iter().flat_map(|c| c.frame);
        let all = rows.flat_map(|row| row.to_array()).collect();
        PyArray1::from_vec(py, all).reshape([self.contacts.len(), 3, 3])
    }

    /// (n,), m.
    #[getter]
    fn gaps<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.contacts.iter().map(|c| c.gap))
    }

    /// (n,): bounding radius of the smaller body of each pair, m.
    #[getter]
    fn sizes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.sizes)
    }

    /// (n,), Coulomb's coefficient of each pair.
    #[getter]
    fn friction<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.friction)
    }
}

impl Contacts {
    fn bodies<'py>(&self, py: Python<'py>, side: usize) -> Bound<'py, PyArray1<i64>> {
        let index = |contact: &Contact| {
            let body = contact.bodies[side] as usize;
            if body < self.moving { body as i64 } else { -1 }
        };
        PyArray1::from_iter(py, self.contacts.iter().map(index))
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

fn layout(rows: usize, columns: usize) -> PyResult<Layout> {
    if !matches!((rows, columns), (1 | 3, 3 | 6)) {
        return Err(ProblemError::new_err(format!(
            "{rows} rows and {columns} columns: a contact has 1 or 3 rows, a body 3 or 6 columns"
        )));
    }
    Ok(Layout { rows, columns })
}

fn same_length(name: &str, have: usize, want: usize) -> PyResult<()> {
    if have != want {
        return Err(ProblemError::new_err(format!(
            "{name} has {have} entries, but {want} are needed"
        )));
    }
    Ok(())
}

/// The rows of a C-ordered table of `N` columns.
fn rows<const N: usize>(table: &Table<'_>) -> PyResult<Vec<[f64; N]>> {
    let (rows, rest) = table.as_slice()?.as_chunks::<N>();
    if table.as_array().ncols() != N || !rest.is_empty() {
        return Err(ProblemError::new_err(format!(
            "a table has {} columns, but {N} are needed",
            table.as_array().ncols()
        )));
    }
    Ok(rows.to_vec())
}

fn table<'py>(
    py: Python<'py>,
    numbers: Vec<f64>,
    columns: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows = numbers.len() / columns;
    PyArray1::from_vec(py, numbers).reshape([rows, columns])
}

fn pose(row: &[f64; 7]) -> Pose {
    let [x, y, z, w, i, j, k] = *row;
    Pose::from_parts(Vector::new(x, y, z), Rotation::from_xyzw(i, j, k, w))
}

fn twist(row: &[f64; 6]) -> Twist {
    let [x, y, z, a, b, c] = *row;
    Twist {
        linear: Vector::new(x, y, z),
        angular: Vector::new(a, b, c),
    }
}

fn twist_row(twist: &Twist) -> [f64; 6] {
    let ([x, y, z], [a, b, c]) = (twist.linear.to_array(), twist.angular.to_array());
    [x, y, z, a, b, c]
}
