//! A stacked system as the core holds it: handed over once, then solved and judged as often as one likes.

use std::borrow::Cow;

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use super::part::Part;
use super::records::table;
use super::solve::law_named;
use crate::arms::{Masses, Rigid, are_rigid};
use crate::exact::{BlockMatrix, Law, ShapeError};
use crate::presolve::{self, Form, FreeMotion, Size, Summary};
use crate::solving::{Stacked, System as Numbers, left_for_others, scale_of};

pyo3::import_exception!(gpx_lcp.errors, ProblemError);

impl From<ShapeError> for PyErr {
    fn from(error: ShapeError) -> Self {
        ProblemError::new_err(error.to_string())
    }
}

/// Read an array of indices, of 32 or 64 bits as SciPy chooses.
fn indices<T>(name: &str, array: &Bound<'_, PyAny>) -> PyResult<Vec<T>>
where
    T: TryFrom<i32> + TryFrom<i64>,
{
    // Asked by type first: an extraction that fails words an error, which takes longer than a small solve.
    if let Ok(narrow) = array.cast::<PyArray1<i32>>() {
        return converted(name, narrow.try_readonly()?.as_slice()?);
    }
    converted(
        name,
        array.extract::<PyReadonlyArray1<'_, i64>>()?.as_slice()?,
    )
}

fn converted<S: Copy + std::fmt::Display, T: TryFrom<S>>(
    name: &str,
    values: &[S],
) -> PyResult<Vec<T>> {
    let convert = |(index, &value): (usize, &S)| {
        T::try_from(value).map_err(|_| {
            ProblemError::new_err(format!(
                "{name}[{index}] is {value}: it must not be negative, nor beyond 32 bits for a column"
            ))
        })
    };
    values.iter().enumerate().map(convert).collect()
}

/// A, or Ĵ with A = Ĵ Ĵᵀ, by blocks, with B, μ and d = max diag A_ii of each contact.
#[pyclass(frozen)]
pub struct System {
    form: Form,
    pub matrix: BlockMatrix,
    pub target: Vec<f64>,
    friction: Vec<f64>,
    scale: Vec<f64>,
    /// The blocks of J in the order of those of Ĵ, where presolve may read them.
    jacobian: Option<Vec<f64>>,
    /// M⁻¹ in blocks, where J is of rigid bodies.
    inverse_mass: Option<Vec<f64>>,
    /// Where it was said.
    free: Option<FreeMotion>,
}

#[pymethods]
impl System {
    /// From a dense A, (rows n, rows n); blocks of zeros are left out.
    #[staticmethod]
    fn from_dense(
        delassus: PyReadonlyArray2<'_, f64>,
        target: PyReadonlyArray1<'_, f64>,
        friction: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let (contacts, rows) = contacts_and_rows(&target, &friction);
        for &length in delassus.shape() {
            same_length("A", length, contacts * rows)?;
        }
        let matrix = BlockMatrix::from_dense(delassus.as_slice()?, contacts, rows);
        Self::of_delassus(matrix, target, friction)
    }

    /// From A in compressed rows.
    #[staticmethod]
    fn from_compressed_rows(
        starts: &Bound<'_, PyAny>,
        columns: &Bound<'_, PyAny>,
        values: PyReadonlyArray1<'_, f64>,
        target: PyReadonlyArray1<'_, f64>,
        friction: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let (contacts, rows) = contacts_and_rows(&target, &friction);
        let (starts, columns): (Vec<usize>, Vec<u32>) =
            (indices("indptr", starts)?, indices("indices", columns)?);
        let scalars = BlockMatrix::new(
            starts,
            columns,
            values.as_slice()?.to_vec(),
            (1, 1),
            contacts * rows,
        )?;
        let matrix = if rows == 1 {
            scalars
        } else {
            scalars.in_blocks(rows)
        };
        Self::of_delassus(matrix, target, friction)
    }

    /// From Ĵ in compressed rows of blocks, (blocks, rows, width), and the same blocks of J; with M⁻¹ in blocks (bodies,
    /// width, width) and the free velocities (bodies width,), where they are known.
    #[staticmethod]
    #[expect(
        clippy::too_many_arguments,
        reason = "arrays of one system, named where it is made"
    )]
    fn from_factor(
        starts: &Bound<'_, PyAny>,
        columns: &Bound<'_, PyAny>,
        blocks: PyReadonlyArray3<'_, f64>,
        jacobian: PyReadonlyArray3<'_, f64>,
        block_columns: usize,
        target: PyReadonlyArray1<'_, f64>,
        friction: PyReadonlyArray1<'_, f64>,
        inverse_mass: PyReadonlyArray3<'_, f64>,
        free_velocity: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Self> {
        let shape = (blocks.shape()[1], blocks.shape()[2]);
        let (starts, columns) = (indices("indptr", starts)?, indices("indices", columns)?);
        let values = blocks.as_slice()?.to_vec();
        let matrix = BlockMatrix::new(starts, columns, values, shape, block_columns)?;
        same_length("jacobian", jacobian.len(), matrix.values.len())?;
        let velocities = block_columns * shape.1;
        same_length("inverse_mass", inverse_mass.len(), velocities * shape.1)?;
        let free = match free_velocity {
            None => None,
            Some(velocity) => {
                same_length("free_velocity", velocity.len(), velocities)?;
                let masses = inverse_mass.as_slice()?.chunks_exact(shape.1 * shape.1);
                FreeMotion::of(velocity.as_slice()?.to_vec(), shape.1, masses)
            }
        };
        let (jacobian, inverse_mass) = (jacobian.as_slice()?, inverse_mass.as_slice()?);
        let rigid = are_rigid(&matrix, jacobian, inverse_mass);
        Ok(Self {
            jacobian: Some(jacobian.to_vec()),
            inverse_mass: rigid.then(|| inverse_mass.to_vec()),
            free,
            ..Self::new(Form::Velocity, matrix, target, friction)?
        })
    }

    /// What presolve would do under one of the laws "normal", "cone" and "coulomb".
    fn presolve(&self, law: &str) -> PyResult<PresolveSummary> {
        let view = self.view(law_named(law)?, self.free.as_ref(), false);
        Ok(presolve_summary(&presolve::summary(&view)))
    }

    /// What presolve leaves under "normal" or "cone" where the whole is to be solved to a tolerance: the impulses (n,
    /// rows) that are known, the parts still to be solved, apart or as one for each shape, and what was done. None where
    /// nothing can be taken away.
    fn reduced<'py>(
        &self,
        py: Python<'py>,
        law: &str,
        tolerance: f64,
        apart: bool,
    ) -> PyResult<Option<Left<'py>>> {
        let law = law_named(law)?;
        let left = py.detach(|| left_for_others(self, law, tolerance, apart));
        let Some((reduced, tolerances)) = left else {
            return Ok(None);
        };
        let rows = self.matrix.height;
        let size = self.target.len();
        let parts = reduced.parts.into_iter().zip(tolerances);
        let parts = parts
            .map(|(part, tolerance)| Part::new(part, tolerance, rows, size))
            .collect();
        let known = table(py, reduced.impulse, rows)?;
        Ok(Some((known, parts, presolve_summary(&reduced.summary))))
    }

    /// The contacts of each island, which no impulse of another one moves.
    fn islands<'py>(&self, py: Python<'py>) -> Vec<Bound<'py, PyArray1<u32>>> {
        let islands = presolve::all_islands(&self.view(Law::Coulomb, None, false));
        let array = |contacts: Vec<u32>| contacts.into_pyarray(py);
        islands.into_iter().map(array).collect()
    }

    /// ‖natural map‖/‖B‖ of impulses (rows n,) under one of the laws "normal", "cone" and "coulomb".
    fn residual(&self, law: &str, impulse: PyReadonlyArray1<'_, f64>) -> PyResult<f64> {
        let impulse = impulse.as_slice()?;
        same_length("impulse", impulse.len(), self.target.len())?;
        Ok(self.system().residual(&law_named(law)?.into(), impulse))
    }
}

impl Stacked for System {
    fn system(&self) -> Numbers<'_> {
        Numbers {
            form: self.form,
            matrix: &self.matrix,
            b: &self.target,
            friction: &self.friction,
            scale: &self.scale,
            rigid: self.rigid(),
        }
    }

    fn jacobian(&self) -> Option<&[f64]> {
        self.jacobian.as_deref()
    }

    fn free_motion(&self) -> Option<Cow<'_, FreeMotion>> {
        self.free.as_ref().map(Cow::Borrowed)
    }
}

impl System {
    fn rigid(&self) -> Option<Rigid<'_>> {
        Some(Rigid {
            jacobian: self.jacobian.as_deref()?,
            masses: Masses::Inverse(self.inverse_mass.as_deref()?),
        })
    }

    fn of_delassus(
        matrix: BlockMatrix,
        target: PyReadonlyArray1<'_, f64>,
        friction: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        Self::new(
            Form::Impulse,
            matrix.with_symmetric_pattern(),
            target,
            friction,
        )
    }

    fn new(
        form: Form,
        matrix: BlockMatrix,
        target: PyReadonlyArray1<'_, f64>,
        friction: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let (target, friction) = (target.as_slice()?.to_vec(), friction.as_slice()?.to_vec());
        let (contacts, rows) = (matrix.block_rows(), matrix.height);
        same_length("friction", friction.len(), contacts)?;
        same_length("B", target.len(), contacts * rows)?;
        Ok(Self {
            scale: scale_of(form, &matrix),
            jacobian: None,
            inverse_mass: None,
            free: None,
            form,
            matrix,
            target,
            friction,
        })
    }
}

/// Refuse an array of another length than needed.
pub fn same_length(name: &'static str, found: usize, needed: usize) -> Result<(), ShapeError> {
    if found == needed {
        Ok(())
    } else {
        Err(ShapeError::Length {
            name,
            found,
            needed,
        })
    }
}

fn contacts_and_rows(
    target: &PyReadonlyArray1<'_, f64>,
    friction: &PyReadonlyArray1<'_, f64>,
) -> (usize, usize) {
    let contacts = friction.len();
    // A system of no contacts has three rows for each of them, as anywhere else.
    (contacts, target.len().checked_div(contacts).unwrap_or(3))
}

/// Contacts, rows, velocities.
type Counts = (usize, usize, usize);

/// Islands; the size before and after; each reduction with the islands it changed and what it removed.
pub type PresolveSummary = (usize, Counts, Counts, Vec<(&'static str, usize, Counts)>);

/// Impulses known already, parts still to be solved, and the summary.
type Left<'py> = (Bound<'py, PyArray2<f64>>, Vec<Part>, PresolveSummary);

fn counts(size: Size) -> Counts {
    (size.contacts, size.rows, size.velocities)
}

/// What presolve did, as Python reads it.
pub fn presolve_summary(summary: &Summary) -> PresolveSummary {
    let removed =
        |&(name, islands, size): &(&'static str, usize, Size)| (name, islands, counts(size));
    (
        summary.islands,
        counts(summary.before),
        counts(summary.after),
        summary.reductions.iter().map(removed).collect(),
    )
}
