//! Python's way to the exact solvers: the interior point and the proximal Newton method.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::exact::{
    BlockMatrix, Form, Law, Limits, Method, Problem, Report, ShapeError, Status, solve,
};

pyo3::import_exception!(gpx_lcp.errors, ProblemError);

impl From<ShapeError> for PyErr {
    fn from(error: ShapeError) -> Self {
        ProblemError::new_err(error.to_string())
    }
}

/// Ĵ (factored) or A, in SciPy's BSR arrays, with B and μ.
#[derive(FromPyObject)]
pub struct Asked<'py> {
    #[pyo3(item)]
    indptr: PyReadonlyArray1<'py, i64>,
    #[pyo3(item)]
    indices: PyReadonlyArray1<'py, i64>,
    #[pyo3(item)]
    data: PyReadonlyArray1<'py, f64>,
    #[pyo3(item)]
    rows: usize,
    #[pyo3(item)]
    block_columns: usize,
    #[pyo3(item)]
    columns: usize,
    #[pyo3(item)]
    factored: bool,
    #[pyo3(item)]
    target: PyReadonlyArray1<'py, f64>,
    #[pyo3(item)]
    friction: PyReadonlyArray1<'py, f64>,
    #[pyo3(item)]
    start: Option<PyReadonlyArray1<'py, f64>>,
}

#[derive(FromPyObject)]
pub struct Wanted {
    #[pyo3(item)]
    method: String,
    #[pyo3(item)]
    law: String,
    #[pyo3(item)]
    pub tolerance: f64,
    #[pyo3(item)]
    pub max_iterations: usize,
    #[pyo3(item)]
    pub time_limit: Option<f64>,
}

impl Wanted {
    pub fn law(&self) -> PyResult<Law> {
        match self.law.as_str() {
            "normal" => Ok(Law::Normal),
            "cone" => Ok(Law::Cone),
            "coulomb" => Ok(Law::Coulomb),
            other => Err(ProblemError::new_err(format!(
                "there is no exact law named {other:?}"
            ))),
        }
    }

    pub fn method(&self) -> PyResult<Method> {
        match self.method.as_str() {
            "interior_point" => Ok(Method::InteriorPoint),
            "newton" => Ok(Method::ProximalNewton),
            other => Err(ProblemError::new_err(format!(
                "there is no exact method named {other:?}"
            ))),
        }
    }
}

/// What came back; the fields are read one by one.
#[pyclass(frozen, get_all)]
pub struct ExactReport {
    impulse: Py<PyArray1<f64>>,
    residual: f64,
    status: &'static str,
    iterations: usize,
    factorisations: usize,
    fill: usize,
    history: Vec<(usize, f64)>,
    fallbacks: Vec<&'static str>,
    infeasibility: Option<Py<PyArray1<f64>>>,
    solve_seconds: f64,
}

/// Solve a contact problem under one of the laws "normal", "cone" and "coulomb".
#[pyfunction]
pub fn exact(py: Python<'_>, problem: Asked<'_>, settings: Wanted) -> PyResult<ExactReport> {
    let (law, method) = (settings.law()?, settings.method()?);
    let matrix = block_matrix(&problem)?;
    let form = if problem.factored {
        Form::Velocity
    } else {
        Form::Impulse
    };
    let (target, friction) = (problem.target.as_slice()?, problem.friction.as_slice()?);
    let start = problem
        .start
        .as_ref()
        .map(|start| start.as_slice())
        .transpose()?;
    if let Some(start) = start {
        same_length("start", start.len(), target.len())?;
    }
    let signal = Mutex::new(None);
    let interrupted = || {
        let mut signal = signal.lock().unwrap_or_else(PoisonError::into_inner);
        if signal.is_none() {
            *signal = Python::attach(|py| py.check_signals()).err();
        }
        signal.is_some()
    };
    let (report, solve_seconds) = py.detach(|| -> Result<_, ShapeError> {
        let problem = Problem::new(matrix, &form, target, friction, law)?;
        let began = Instant::now();
        let limits = Limits::new(
            settings.tolerance,
            settings.max_iterations,
            settings.time_limit,
            &interrupted,
        );
        let report = solve(&problem, method, &limits, start);
        Ok((report, began.elapsed()))
    })?;
    if let Some(signal) = signal.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(signal);
    }
    Ok(answer(py, report, solve_seconds.as_secs_f64()))
}

fn block_matrix(problem: &Asked<'_>) -> PyResult<BlockMatrix> {
    let index = |name: &'static str, array: &PyReadonlyArray1<'_, i64>| -> PyResult<Vec<usize>> {
        let convert = |(index, &value): (usize, &i64)| {
            usize::try_from(value).map_err(|_| {
                ProblemError::new_err(format!(
                    "{name}[{index}] is {value}: it must not be negative"
                ))
            })
        };
        array.as_slice()?.iter().enumerate().map(convert).collect()
    };
    let starts = index("indptr", &problem.indptr)?;
    let columns = index("indices", &problem.indices)?
        .into_iter()
        .map(|column| column as u32)
        .collect();
    let shape = (problem.rows, problem.block_columns);
    Ok(BlockMatrix::new(
        starts,
        columns,
        problem.data.as_slice()?.to_vec(),
        shape,
        problem.columns,
    )?)
}

fn same_length(name: &'static str, found: usize, needed: usize) -> Result<(), ShapeError> {
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

fn answer(py: Python<'_>, report: Report, solve_seconds: f64) -> ExactReport {
    ExactReport {
        impulse: report.impulse.into_pyarray(py).unbind(),
        residual: report.residual,
        status: match report.status {
            Status::Solved => "solved",
            Status::MaxIterations => "max_iterations",
            Status::Stalled => "stalled",
            Status::Infeasible => "infeasible",
        },
        iterations: report.iterations,
        factorisations: report.factorisations,
        fill: report.fill,
        history: report.history,
        fallbacks: report.fallbacks,
        infeasibility: report
            .infeasibility
            .map(|ray| ray.into_pyarray(py).unbind()),
        solve_seconds,
    }
}
