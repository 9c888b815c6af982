//! What a time step works with, as Python sees it: contacts and stacked systems; and the arrays they are made of.

use numpy::{
    Element, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
};
use parry3d_f64::math::{Pose, Rotation, Vector};
use pyo3::prelude::*;

use super::scene::Bodies;
use crate::bodies::{Bodies as BodyData, Twist};
use crate::collision::Contact;
use crate::exact::BlockMatrix;
use crate::stacking::Stack as StackData;

pyo3::import_exception!(gpx_lcp.errors, ProblemError);

pub type Floats<'py> = PyReadonlyArray1<'py, f64>;
pub type Table<'py> = PyReadonlyArray2<'py, f64>;
type Pairs<'py> = PyReadonlyArray2<'py, u32>;
pub type Indices<'py> = Bound<'py, PyArray1<i32>>;
pub type Blocks<'py> = Bound<'py, PyArray3<f64>>;

/// The contacts of one state.
#[pyclass(frozen, module = "gpx_lcp._core")]
pub struct Contacts {
    pub contacts: Vec<Contact>,
    /// Bodies from this index on never move.
    pub moving: usize,
    pub friction: Vec<f64>,
}

/// The stacked system of a step.
#[pyclass(frozen, module = "gpx_lcp._core")]
pub struct Stack(pub StackData);

#[pymethods]
impl Contacts {
    /// bodies (n, 2) and features (n, 2) as the core numbers them, points (n, 3), frames (n, 9), gaps (n,).
    #[new]
    fn from_arrays(
        among: &Bodies,
        bodies: Pairs<'_>,
        features: Pairs<'_>,
        points: Table<'_>,
        frames: Table<'_>,
        gaps: Floats<'_>,
    ) -> PyResult<Self> {
        let bodies = rows::<u32, 2>(&bodies)?;
        let features = rows::<u32, 2>(&features)?;
        let points = rows::<f64, 3>(&points)?;
        let frames = rows::<f64, 9>(&frames)?;
        let gaps = gaps.as_slice()?;
        for (name, have) in [
            ("features", features.len()),
            ("points", points.len()),
            ("frames", frames.len()),
            ("gaps", gaps.len()),
        ] {
            same_length(name, have, bodies.len())?;
        }
        if let Some(pair) = bodies.iter().find(|pair| !among.0.may_touch(**pair)) {
            return Err(ProblemError::new_err(format!(
                "a contact is between the bodies {pair:?}: two of {} are needed, at least one of which moves",
                among.0.len()
            )));
        }
        let contacts = (0..bodies.len()).map(|k| Contact {
            bodies: bodies[k],
            features: features[k],
            point: Vector::from_array(points[k]),
            frame: std::array::from_fn(|r| Vector::from_slice(&frames[k][3 * r..])),
            gap: gaps[k],
        });
        Ok(Self::new(&among.0, contacts.collect()))
    }

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

    /// (n, 2), bodies a and b as the core numbers them: those that never move follow the moving ones.
    #[getter]
    fn pairs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let all = self.contacts.iter().flat_map(|c| c.bodies).collect();
        PyArray1::from_vec(py, all).reshape([self.contacts.len(), 2])
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

    /// (n,), Coulomb's coefficient of each pair.
    #[getter]
    fn friction<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.friction)
    }
}

impl Contacts {
    pub fn new(bodies: &BodyData, contacts: Vec<Contact>) -> Self {
        Self {
            friction: contacts.iter().map(|c| bodies.friction(c.bodies)).collect(),
            moving: bodies.moving,
            contacts,
        }
    }

    fn bodies<'py>(&self, py: Python<'py>, side: usize) -> Bound<'py, PyArray1<i64>> {
        let index = |contact: &Contact| {
            let body = contact.bodies[side] as usize;
            if body < self.moving { body as i64 } else { -1 }
        };
        PyArray1::from_iter(py, self.contacts.iter().map(index))
    }
}

#[pymethods]
impl Stack {
    /// The blocks of J and of Ĵ in block compressed sparse rows: (row_starts, columns, blocks, whitened blocks).
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Indices<'py>, Indices<'py>, Blocks<'py>, Blocks<'py>)> {
        let stack = &self.0;
        let (starts, columns, whitened) = block_rows(py, &stack.whitened)?;
        let blocks = PyArray1::from_slice(py, &stack.blocks).reshape(whitened.dims())?;
        Ok((starts, columns, blocks, whitened))
    }

    /// M⁻¹ as (moving, columns, columns) blocks.
    fn inverse_mass<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (bodies, columns) = (self.0.roots.len(), self.0.layout.columns);
        PyArray1::from_vec(py, self.0.inverse_mass()).reshape([bodies, columns, columns])
    }

    /// The velocities of the bodies after every force but contact, (moving, columns).
    #[getter]
    fn free_velocities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let columns = self.0.layout.columns;
        let rows = self.0.free.iter().map(twist_row);
        let numbers = rows.flat_map(|row| row.into_iter().take(columns)).collect();
        table(py, numbers, columns)
    }

    /// (rows n,), m/s.
    #[getter]
    fn target<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.b)
    }

    /// (n,), Coulomb's coefficient of each contact.
    #[getter]
    fn friction<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.friction)
    }

    /// (n, 2), e - 1 of each contact's pair, normal and tangential.
    #[getter]
    fn restitution<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(
            py,
            self.0.restitution.iter().flatten().copied().collect(),
            2,
        )
    }

    /// (n,), whether elasticity acts in the contact.
    #[getter]
    fn impacts<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        PyArray1::from_slice(py, &self.0.impacts)
    }
}

pub fn same_length(name: &str, have: usize, want: usize) -> PyResult<()> {
    if have != want {
        return Err(ProblemError::new_err(format!(
            "{name} has {have} entries, but {want} are needed"
        )));
    }
    Ok(())
}

/// The rows of a C-ordered table of `N` columns.
pub fn rows<T: Element + Copy, const N: usize>(
    table: &PyReadonlyArray2<'_, T>,
) -> PyResult<Vec<[T; N]>> {
    let (rows, rest) = table.as_slice()?.as_chunks::<N>();
    if table.as_array().ncols() != N || !rest.is_empty() {
        return Err(ProblemError::new_err(format!(
            "a table has {} columns, but {N} are needed",
            table.as_array().ncols()
        )));
    }
    Ok(rows.to_vec())
}

/// A matrix in compressed rows of blocks: starts, columns, and blocks (blocks, height, width).
pub fn block_rows<'py>(
    py: Python<'py>,
    matrix: &BlockMatrix,
) -> PyResult<(Indices<'py>, Indices<'py>, Blocks<'py>)> {
    let shape = [matrix.columns.len(), matrix.height, matrix.width];
    Ok((
        PyArray1::from_iter(py, matrix.starts.iter().map(|&start| start as i32)),
        PyArray1::from_iter(py, matrix.columns.iter().map(|&column| column as i32)),
        PyArray1::from_slice(py, &matrix.values).reshape(shape)?,
    ))
}

pub fn table<'py>(
    py: Python<'py>,
    numbers: Vec<f64>,
    columns: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows = numbers.len() / columns;
    PyArray1::from_vec(py, numbers).reshape([rows, columns])
}

pub fn pose(row: &[f64; 7]) -> Pose {
    let [x, y, z, w, i, j, k] = *row;
    Pose::from_parts(Vector::new(x, y, z), Rotation::from_xyzw(i, j, k, w))
}

pub fn twist(row: &[f64; 6]) -> Twist {
    let [x, y, z, a, b, c] = *row;
    Twist {
        linear: Vector::new(x, y, z),
        angular: Vector::new(a, b, c),
    }
}

pub fn twist_row(twist: &Twist) -> [f64; 6] {
    let ([x, y, z], [a, b, c]) = (twist.linear.to_array(), twist.angular.to_array());
    [x, y, z, a, b, c]
}
