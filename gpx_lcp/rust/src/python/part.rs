//! A part that presolve leaves of a system, for solvers outside the core.

use numpy::{PyArray1, PyArray2, PyReadonlyArray2, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use super::records::{Blocks, Indices, block_rows, table};
use super::system::same_length;
use crate::presolve::{self, Form};

/// A reduced system, and the way to its impulses and back.
#[pyclass(frozen, module = "gpx_lcp._core")]
pub struct Part {
    part: presolve::Part,
    #[pyo3(get)]
    tolerance: f64,
    /// Of the whole system, rows per contact and in all.
    rows: usize,
    size: usize,
}

impl Part {
    pub fn new(part: presolve::Part, tolerance: f64, rows: usize, size: usize) -> Self {
        Self {
            part,
            tolerance,
            rows,
            size,
        }
    }
}

#[pymethods]
impl Part {
    /// Whether `matrix` is Ĵ, with A = Ĵ Ĵᵀ, and not A.
    #[getter]
    fn of_bodies(&self) -> bool {
        self.part.form == Form::Velocity
    }

    /// Ĵ or A in compressed rows of blocks: starts, columns, blocks (blocks, rows, width), and the number of columns.
    fn matrix<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Indices<'py>, Indices<'py>, Blocks<'py>, usize)> {
        let matrix = &self.part.matrix;
        let (starts, columns, blocks) = block_rows(py, matrix)?;
        Ok((starts, columns, blocks, matrix.block_columns))
    }

    /// B, (rows n,).
    #[getter]
    fn target<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.part.b)
    }

    /// (n,)
    #[getter]
    fn friction<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.part.friction)
    }

    /// The impulses of the part, (n, rows), that those of the whole system come to.
    fn restrict<'py>(
        &self,
        py: Python<'py>,
        whole: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        same_length("whole", whole.len(), self.size)?;
        let reduced = self.part.restrict(self.rows, whole.as_slice()?);
        table(py, reduced, self.part.rows)
    }

    /// Write the impulses of the part, (n, rows), into those of the whole system.
    fn lift(
        &self,
        impulse: PyReadonlyArray2<'_, f64>,
        mut whole: PyReadwriteArray2<'_, f64>,
    ) -> PyResult<()> {
        same_length("impulse", impulse.len(), self.part.b.len())?;
        same_length("whole", whole.len(), self.size)?;
        self.part
            .lift(self.rows, impulse.as_slice()?, whole.as_slice_mut()?);
        Ok(())
    }
}
