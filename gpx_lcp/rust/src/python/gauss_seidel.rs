//! Python's way to the sweeps: picks the kernel that fits the rows, the bodies and the law.

use std::time::Duration;

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use super::system::converted;
use crate::contact::Law;
use crate::delassus::{BlockRows, Delassus, StructureError};
use crate::exact::BlockMatrix;
use crate::explicit::Explicit;
use crate::factored::Factored;
use crate::friction_cone::{ConvexCone, Coulomb};
use crate::gauss_seidel::{Outcome, Problem, Settings, Stop, solve};
use crate::polygon::Polygon;
use crate::program::Program;
use crate::small_matrix::Vector;

pyo3::import_exception!(gpx_lcp.errors, ProblemError);

type Floats<'py> = PyReadonlyArray1<'py, f64>;
type Integers<'py> = PyReadonlyArray1<'py, i64>;

impl From<StructureError> for PyErr {
    fn from(error: StructureError) -> Self {
        ProblemError::new_err(error.to_string())
    }
}

/// The block rows of Ĵ or of A, in SciPy's BSR arrays.
#[derive(FromPyObject)]
pub struct Rows<'py> {
    #[pyo3(item)]
    indptr: Integers<'py>,
    #[pyo3(item)]
    indices: Integers<'py>,
    #[pyo3(item)]
    data: Floats<'py>,
    #[pyo3(item)]
    columns: usize,
    #[pyo3(item)]
    block_columns: usize,
    #[pyo3(item)]
    factored: bool,
}

#[derive(FromPyObject)]
pub struct Question<'py> {
    #[pyo3(item)]
    rows: usize,
    #[pyo3(item)]
    target: Floats<'py>,
    #[pyo3(item)]
    friction: Floats<'py>,
    #[pyo3(item)]
    scale: Floats<'py>,
    #[pyo3(item)]
    target_norm: f64,
    #[pyo3(item)]
    start: Floats<'py>,
}

#[derive(FromPyObject)]
pub struct Effort<'py> {
    #[pyo3(item)]
    law: String,
    #[pyo3(item)]
    corners: Floats<'py>,
    #[pyo3(item)]
    tolerance: f64,
    #[pyo3(item)]
    max_sweeps: usize,
    #[pyo3(item)]
    time_limit: Option<f64>,
    #[pyo3(item)]
    relaxation: f64,
    #[pyo3(item)]
    acceleration: bool,
    #[pyo3(item)]
    threads: usize,
}

impl Effort<'_> {
    pub fn settings(&self) -> Settings {
        Settings {
            tolerance: self.tolerance,
            max_sweeps: self.max_sweeps,
            // Longer than a Duration can be is no limit.
            time_limit: self
                .time_limit
                .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok()),
            relaxation: self.relaxation,
            acceleration: self.acceleration,
            threads: self.threads,
        }
    }

    /// The program that `law` and `corners` stand for; with one row per contact there is no friction.
    pub fn program(&self, rows: usize) -> PyResult<Program> {
        match self.law.as_str() {
            _ if rows == 1 => Ok(Program::Normal),
            "coulomb" => Ok(Program::Coulomb),
            "cone" => Ok(Program::Cone),
            "polygon" => Ok(Program::Polygon(
                self.corners.as_slice()?.as_chunks::<2>().0.to_vec(),
            )),
            law => Err(no_law(law)),
        }
    }
}

fn no_law(law: &str) -> PyErr {
    ProblemError::new_err(format!("there is no law of contact named {law:?}"))
}

type Answer<'py> = (
    Bound<'py, PyArray1<f64>>,
    &'static str,
    usize,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
    f64,
);

/// Sweep until the residual is within the tolerance.
///
/// Returns the impulse, why it stopped, the sweeps done, the sweeps and the residual at each evaluation, and the seconds
/// that sweeping took.
#[pyfunction]
pub fn gauss_seidel<'py>(
    py: Python<'py>,
    matrix: Rows<'py>,
    question: Question<'py>,
    effort: Effort<'py>,
) -> PyResult<Answer<'py>> {
    match (question.rows, matrix.factored, matrix.block_columns) {
        (1, true, 3) => factored::<1, 3>(py, &matrix, &question, &effort),
        (1, true, 6) => factored::<1, 6>(py, &matrix, &question, &effort),
        (2, true, 3) => factored::<2, 3>(py, &matrix, &question, &effort),
        (2, true, 6) => factored::<2, 6>(py, &matrix, &question, &effort),
        (3, true, 3) => factored::<3, 3>(py, &matrix, &question, &effort),
        (3, true, 6) => factored::<3, 6>(py, &matrix, &question, &effort),
        (1, false, 1) => explicit::<1>(py, &matrix, &question, &effort),
        (2, false, 2) => explicit::<2>(py, &matrix, &question, &effort),
        (3, false, 3) => explicit::<3>(py, &matrix, &question, &effort),
        (rows, _, columns) => Err(ProblemError::new_err(format!(
            "there is no kernel for blocks of {rows} x {columns}"
        ))),
    }
}

fn factored<'py, const R: usize, const D: usize>(
    py: Python<'py>,
    matrix: &Rows<'py>,
    question: &Question<'py>,
    effort: &Effort<'py>,
) -> PyResult<Answer<'py>> {
    let (starts, columns) = (matrix.indptr.as_slice()?, matrix.indices.as_slice()?);
    let whitened = BlockMatrix::new(
        converted("indptr", starts)?,
        converted("indices", columns)?,
        matrix.data.as_slice()?.to_vec(),
        (R, D),
        matrix.columns,
    )?;
    let factored = Factored::<R, D>::new(&whitened)
        .ok_or_else(|| ProblemError::new_err("a contact touches more than two bodies: give A"))?;
    with_law(py, factored, question, effort)
}

fn explicit<'py, const R: usize>(
    py: Python<'py>,
    matrix: &Rows<'py>,
    question: &Question<'py>,
    effort: &Effort<'py>,
) -> PyResult<Answer<'py>> {
    let rows = block_rows::<R, R>(matrix)?;
    if rows.len() != matrix.columns {
        return Err(ProblemError::new_err(format!(
            "A has {} block rows but {} columns",
            rows.len(),
            matrix.columns
        )));
    }
    with_law(py, Explicit::new(rows), question, effort)
}

fn block_rows<const R: usize, const C: usize>(matrix: &Rows) -> PyResult<BlockRows<R, C>> {
    Ok(BlockRows::new(
        matrix.indptr.as_slice()?,
        matrix.indices.as_slice()?,
        matrix.data.as_slice()?,
        matrix.columns,
    )?)
}

fn with_law<'py, const R: usize, A: Delassus<R> + Send>(
    py: Python<'py>,
    delassus: A,
    question: &Question<'py>,
    effort: &Effort<'py>,
) -> PyResult<Answer<'py>> {
    match effort.law.as_str() {
        // With one row they are all the same.
        _ if R == 1 => sweep(py, delassus, &Coulomb, question, effort),
        "coulomb" => sweep(py, delassus, &Coulomb, question, effort),
        "cone" => sweep(py, delassus, &ConvexCone, question, effort),
        "polygon" => {
            let corners = effort.corners.as_slice()?;
            let corner = |at: usize| {
                std::array::from_fn(|r| {
                    if r == 0 {
                        0.0
                    } else {
                        corners[at * (R - 1) + r - 1]
                    }
                })
            };
            let count = if R > 1 { corners.len() / (R - 1) } else { 0 };
            sweep(
                py,
                delassus,
                &Polygon::<R>::new((0..count).map(corner).collect()),
                question,
                effort,
            )
        }
        law => Err(no_law(law)),
    }
}

fn sweep<'py, const R: usize, A: Delassus<R> + Send, L: Law<R>>(
    py: Python<'py>,
    delassus: A,
    law: &L,
    question: &Question<'py>,
    effort: &Effort<'py>,
) -> PyResult<Answer<'py>> {
    let contacts = delassus.len();
    let target = by_contact::<R>("target", question.target.as_slice()?, contacts)?;
    let start = by_contact::<R>("start", question.start.as_slice()?, contacts)?;
    let problem = Problem {
        target: &target,
        friction: sized("friction", question.friction.as_slice()?, contacts)?,
        scale: sized("scale", question.scale.as_slice()?, contacts)?,
        target_norm: question.target_norm,
    };
    let settings = effort.settings();
    let mut signal = None;
    let mut go_on = || {
        signal = Python::attach(|py| py.check_signals()).err();
        signal.is_none()
    };
    let outcome = py.detach(|| solve(&delassus, law, &problem, &start, &settings, &mut go_on));
    if let Some(signal) = signal {
        return Err(signal);
    }
    Ok(answer(py, outcome))
}

pub fn stop_name(stop: Stop) -> &'static str {
    match stop {
        Stop::Solved => "solved",
        Stop::MaxSweeps => "max_sweeps",
        Stop::TimeLimit => "time_limit",
        Stop::Stalled => "stalled",
        Stop::NumericalError => "numerical_error",
        Stop::Interrupted => "interrupted",
    }
}

fn answer<const R: usize>(py: Python<'_>, outcome: Outcome<R>) -> Answer<'_> {
    let stop = stop_name(outcome.stop);
    let (sweeps, residuals): (Vec<i64>, Vec<f64>) = outcome
        .history
        .iter()
        .map(|&(sweeps, residual)| (sweeps as i64, residual))
        .unzip();
    (
        outcome.impulse.into_flattened().into_pyarray(py),
        stop,
        outcome.sweeps,
        sweeps.into_pyarray(py),
        residuals.into_pyarray(py),
        outcome.elapsed.as_secs_f64(),
    )
}

fn by_contact<const R: usize>(
    name: &str,
    values: &[f64],
    contacts: usize,
) -> PyResult<Vec<Vector<R>>> {
    let rows = sized(name, values, R * contacts)?;
    Ok(rows
        .chunks_exact(R)
        .map(|row| std::array::from_fn(|r| row[r]))
        .collect())
}

fn sized<'a>(name: &str, values: &'a [f64], needed: usize) -> PyResult<&'a [f64]> {
    if values.len() == needed {
        return Ok(values);
    }
    Err(ProblemError::new_err(format!(
        "{name} has length {} but {needed} is needed",
        values.len()
    )))
}
