//! A stacked system as the core holds it: handed over once, then solved and judged as often as one likes.

use numpy::{
    IntoPyArray, PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use super::exact::law_named;
use crate::exact::{BlockMatrix, Law, Operator, ShapeError};
use crate::presolve::{self, Form, FreeMotion, Size, Summary, View};
use crate::program::Program;
use crate::solving::{Interrupted, System as Swept, held};

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

pub(super) fn converted<S: Copy + std::fmt::Display, T: TryFrom<S>>(
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
    pub operator: Operator,
    pub target: Vec<f64>,
    pub friction: Vec<f64>,
    scale: Vec<f64>,
    /// The blocks of J in the order of those of Ĵ, where presolve may read them.
    jacobian: Option<Vec<f64>>,
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
                Some(FreeMotion {
                    velocity: velocity.as_slice()?.to_vec(),
                    inverse_mass: inverse_mass.as_slice()?.to_vec(),
                })
            }
        };
        Ok(Self {
            jacobian: Some(jacobian.as_slice()?.to_vec()),
            free,
            ..Self::new(Operator::Velocity(matrix), target, friction)?
        })
    }

    /// What presolve would do under one of the laws "normal", "cone" and "coulomb".
    fn presolve(&self, law: &str) -> PyResult<PresolveSummary> {
        let view = self.view(law_named(law)?);
        Ok(presolve_summary(&presolve::summary(&view)))
    }

    /// The contacts of each island, which no impulse of another one moves.
    fn islands<'py>(&self, py: Python<'py>) -> Vec<Bound<'py, PyArray1<u32>>> {
        let islands = presolve::all_islands(&self.view(Law::Coulomb));
        let array = |contacts: Vec<u32>| contacts.into_pyarray(py);
        islands.into_iter().map(array).collect()
    }

    /// ‖natural map‖/‖B‖ of impulses (rows n,) under one of the laws "normal", "cone" and "coulomb".
    fn residual(&self, law: &str, impulse: PyReadonlyArray1<'_, f64>) -> PyResult<f64> {
        let impulse = impulse.as_slice()?;
        same_length("impulse", impulse.len(), self.target.len())?;
        Ok(self.residual_of(&law_named(law)?.into(), impulse))
    }
}

/// Whether contacts have one or three rows and two bodies at most, and bodies three or six velocities.
fn is_of_a_scene(matrix: &BlockMatrix) -> bool {
    let mut contacts = matrix.starts.windows(2);
    matches!((matrix.height, matrix.width), (1 | 3, 3 | 6))
        && contacts.all(|range| range[1] - range[0] <= 2)
}

impl System {
    /// The start impulses, or none, where that is a solution, or nearly so; with its residual.
    pub fn settled(
        &self,
        program: &Program,
        start: &[f64],
        tolerance: f64,
        interrupted: Interrupted,
    ) -> Option<(Vec<f64>, f64)> {
        let residual = self.residual_of(program, start);
        let (friction, scale, b) = (&self.friction, &self.scale, &self.target);
        match &self.operator {
            Operator::Velocity(whitened) if is_of_a_scene(whitened) => {
                let system = Swept {
                    whitened,
                    b,
                    friction,
                    scale,
                };
                held(system, program, start, residual, tolerance, interrupted)
            }
            _ => program.settled((friction, scale, b), start, residual, tolerance),
        }
    }

    /// ‖natural map‖/‖B‖ of impulses, rows per contact. From Ĵ it is the same number, bit for bit, as in a native step.
    pub fn residual_of(&self, program: &Program, impulse: &[f64]) -> f64 {
        let velocity: Vec<f64> = match &self.operator {
            Operator::Velocity(factor) => {
                let numbers = (
                    self.friction.as_slice(),
                    self.scale.as_slice(),
                    self.target.as_slice(),
                );
                return program.residual_of(factor, numbers, impulse);
            }
            Operator::Impulse(matrix) => {
                let mut product = vec![[0.0; 3]; self.friction.len()];
                matrix.times(impulse, &mut product);
                let product = product.iter().flat_map(|u| &u[..matrix.height]);
                product.zip(&self.target).map(|(u, b)| u - b).collect()
            }
        };
        program.relative_map(
            &self.friction,
            &self.scale,
            &self.target,
            impulse,
            &velocity,
        )
    }

    /// As presolve reads it.
    pub fn view(&self, law: Law) -> View<'_> {
        let (form, matrix) = match &self.operator {
            Operator::Velocity(factor) => (Form::Velocity, factor),
            Operator::Impulse(delassus) => (Form::Impulse, delassus),
        };
        View {
            form,
            rows: matrix.height,
            width: matrix.width,
            bodies: matrix.block_columns,
            starts: &matrix.starts,
            columns: &matrix.columns,
            whitened: &matrix.values,
            jacobian: self.jacobian.as_deref(),
            free: self.free.as_ref(),
            b: &self.target,
            largest: presolve::largest(&self.target),
            friction: &self.friction,
            law,
        }
    }

    fn of_delassus(
        matrix: BlockMatrix,
        target: PyReadonlyArray1<'_, f64>,
        friction: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let operator = Operator::Impulse(matrix.with_symmetric_pattern());
        Self::new(operator, target, friction)
    }

    fn new(
        operator: Operator,
        target: PyReadonlyArray1<'_, f64>,
        friction: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let (target, friction) = (target.as_slice()?.to_vec(), friction.as_slice()?.to_vec());
        let (contacts, rows) = (operator.contacts(), operator.rows());
        same_length("friction", friction.len(), contacts)?;
        same_length("B", target.len(), contacts * rows)?;
        let diagonal = operator.diagonal();
        let largest = |d: &[f64; 3]| d.iter().copied().fold(0.0, f64::max);
        Ok(Self {
            scale: diagonal.iter().map(largest).collect(),
            jacobian: None,
            free: None,
            operator,
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
