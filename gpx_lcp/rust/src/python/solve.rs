//! Python's way to the core's own methods, alone or in a native step.

use std::sync::{Mutex, PoisonError};

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::records::table;
use super::system::{PresolveSummary, System, presolve_summary, same_length};
use crate::exact;
use crate::gauss_seidel::Stop;
use crate::program::Program;
use crate::solving::{self, Answer, Details, Effort, Method, Status};

pyo3::import_exception!(gpx_lcp.errors, ProblemError);

/// A program and a method, with how hard it tries.
#[derive(FromPyObject)]
pub struct Wanted<'py> {
    #[pyo3(item)]
    program: String,
    #[pyo3(item)]
    corners: PyReadonlyArray1<'py, f64>,
    #[pyo3(item)]
    method: String,
    #[pyo3(item)]
    tolerance: f64,
    #[pyo3(item)]
    max_iterations: usize,
    #[pyo3(item)]
    time_limit: Option<f64>,
    #[pyo3(item)]
    relaxation: f64,
    #[pyo3(item)]
    acceleration: bool,
    #[pyo3(item)]
    presolve: bool,
    #[pyo3(item)]
    threads: usize,
}

impl Wanted<'_> {
    pub fn effort(&self) -> PyResult<Effort> {
        let program = match self.program.as_str() {
            "polygon" => Program::Polygon(self.corners.as_slice()?.as_chunks::<2>().0.to_vec()),
            other => law_named(other)?.into(),
        };
        let method = match self.method.as_str() {
            "gauss_seidel" => Method::Sweeps {
                relaxation: self.relaxation,
                acceleration: self.acceleration,
            },
            "interior_point" => Method::Exact(exact::Method::InteriorPoint),
            "newton" => Method::Exact(exact::Method::ProximalNewton),
            other => {
                return Err(ProblemError::new_err(format!(
                    "the core has no method named {other:?}"
                )));
            }
        };
        if let (Method::Exact(_), Program::Polygon(_)) = (method, &program) {
            return Err(ProblemError::new_err("no exact method solves polygons"));
        }
        Ok(Effort {
            program,
            method,
            tolerance: self.tolerance,
            max_iterations: self.max_iterations,
            time_limit: self.time_limit,
            presolve: self.presolve,
            threads: self.threads,
        })
    }
}

impl From<exact::Law> for Program {
    fn from(law: exact::Law) -> Self {
        match law {
            exact::Law::Normal => Program::Normal,
            exact::Law::Cone => Program::Cone,
            exact::Law::Coulomb => Program::Coulomb,
        }
    }
}

pub fn law_named(name: &str) -> PyResult<exact::Law> {
    match name {
        "normal" => Ok(exact::Law::Normal),
        "cone" => Ok(exact::Law::Cone),
        "coulomb" => Ok(exact::Law::Coulomb),
        other => Err(ProblemError::new_err(format!(
            "there is no isotropic law named {other:?}"
        ))),
    }
}

/// Solve a stacked system by one of the core's own methods.
#[pyfunction]
pub fn solve(
    py: Python<'_>,
    system: &Bound<'_, System>,
    effort: Wanted<'_>,
    start: Option<PyReadonlyArray1<'_, f64>>,
) -> PyResult<Found> {
    let effort = effort.effort()?;
    let system = system.get();
    let start = start.as_ref().map(|start| start.as_slice()).transpose()?;
    if let Some(start) = start {
        same_length("start", start.len(), system.target.len())?;
    }
    let signal = Mutex::new(None);
    let interrupted = || {
        let mut signal = signal.lock().unwrap_or_else(PoisonError::into_inner);
        if signal.is_none() {
            *signal = Python::attach(|py| py.check_signals()).err();
        }
        signal.is_some()
    };
    let answer = py.detach(|| solving::solve(system, &effort, start, None, &interrupted));
    if let Some(signal) = signal.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(signal);
    }
    Ok(Found {
        rows: system.matrix.height,
        answer: answer.expect("only a signal interrupts"),
    })
}

/// Start impulses, (n, rows), brought into the cones of a program, and how far they moved, relative to the largest entry.
#[pyfunction]
pub fn admit<'py>(
    py: Python<'py>,
    effort: Wanted<'_>,
    friction: PyReadonlyArray1<'_, f64>,
    impulse: PyReadonlyArray2<'_, f64>,
) -> PyResult<(Bound<'py, PyArray2<f64>>, f64)> {
    let (contacts, rows) = (impulse.shape()[0], impulse.shape()[1]);
    let friction = friction.as_slice()?;
    same_length("friction", friction.len(), contacts)?;
    let mut inside = impulse.as_slice()?.to_vec();
    let moved = effort.effort()?.program.admit(friction, &mut inside, rows);
    let inside = inside.into_pyarray(py).reshape([contacts, rows])?;
    Ok((inside, moved))
}

/// What a method found.
#[pyclass(frozen, module = "gpx_lcp._core")]
pub struct Found {
    pub rows: usize,
    pub answer: Answer,
}

#[pymethods]
impl Found {
    /// (n, rows), N s.
    #[getter]
    fn impulse<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, self.answer.impulse.clone(), self.rows)
    }

    /// The name of a `Status`, in small letters.
    #[getter]
    fn status(&self) -> &'static str {
        match self.answer.status {
            Status::Solved => "solved",
            Status::MaxIterations => "max_iterations",
            Status::Stalled => "stalled",
            Status::Infeasible => "infeasible",
            Status::NumericalError => "numerical_error",
        }
    }

    #[getter]
    fn residual(&self) -> f64 {
        self.answer.residual
    }

    #[getter]
    fn iterations(&self) -> usize {
        self.answer.iterations
    }

    #[getter]
    fn setup_seconds(&self) -> f64 {
        self.answer.setup.as_secs_f64()
    }

    #[getter]
    fn solve_seconds(&self) -> f64 {
        self.answer.elapsed.as_secs_f64()
    }

    /// (iterations, residual) where the method tells.
    #[getter]
    fn history(&self) -> Vec<(usize, f64)> {
        self.answer.history.clone()
    }

    #[getter]
    fn fallbacks(&self) -> Vec<&'static str> {
        match &self.answer.details {
            Details::Exact(found) => found.fallbacks.clone(),
            _ => Vec::new(),
        }
    }

    /// What presolve did; None where it was not wanted, or found nothing to do.
    #[getter]
    fn presolve(&self) -> Option<PresolveSummary> {
        self.answer.presolve.as_ref().map(presolve_summary)
    }

    /// The method's own figures.
    #[getter]
    fn extras<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let extras = PyDict::new(py);
        match &self.answer.details {
            Details::Nothing => {}
            Details::Sweeps(stop) => extras.set_item("stopped_by", stop_name(*stop))?,
            Details::Exact(found) => {
                extras.set_item("factorisations", found.factorisations)?;
                extras.set_item("factor_seconds", found.factor_time.as_secs_f64())?;
                extras.set_item("fill", found.fill)?;
                if let Some(ray) = &found.infeasibility {
                    let ray: Bound<'py, PyArray1<f64>> = ray.clone().into_pyarray(py);
                    extras.set_item("infeasibility", ray)?;
                }
            }
        }
        Ok(extras)
    }
}

fn stop_name(stop: Stop) -> &'static str {
    match stop {
        Stop::Solved => "solved",
        Stop::MaxSweeps => "max_sweeps",
        Stop::TimeLimit => "time_limit",
        Stop::Stalled => "stalled",
        Stop::NumericalError => "numerical_error",
        Stop::Interrupted => "interrupted",
    }
}
