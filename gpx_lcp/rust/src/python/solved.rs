//! What a native step is told of its solver, and what it solved, as Python sees it.

use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::exact::Wanted;
use super::gauss_seidel::{Effort as SweepEffort, stop_name};
use super::records::{ProblemError, Stack, table};
use super::system::{PresolveSummary, presolve_summary};
use crate::solving::{Answer, Details, Effort, Method, Status};
use crate::stepping::{Efforts, Solved as SolvedData};

/// The last step of a world: the system that it solved, and the answer.
#[pyclass(frozen, module = "gpx_lcp._core")]
pub struct Solved {
    #[pyo3(get)]
    stack: Py<Stack>,
    answer: Answer,
    /// Whether the step was solved as one without friction.
    #[pyo3(get)]
    frictionless: bool,
    /// How far the start impulses had to be moved into their cones, where there were any.
    #[pyo3(get)]
    start_moved: Option<f64>,
}

impl Solved {
    pub fn new(py: Python<'_>, solved: SolvedData) -> PyResult<Self> {
        Ok(Self {
            frictionless: !solved.stack.has_friction(),
            stack: Py::new(py, Stack(solved.stack))?,
            answer: solved.answer,
            start_moved: solved.start_moved,
        })
    }
}

/// How steps are solved, from a table of settings.
#[derive(FromPyObject)]
pub struct Settings<'py> {
    #[pyo3(item)]
    tolerance: f64,
    #[pyo3(item)]
    with_friction: Bound<'py, PyDict>,
    #[pyo3(item)]
    without_friction: Bound<'py, PyDict>,
}

impl Settings<'_> {
    pub fn efforts(&self) -> PyResult<Efforts> {
        Ok(Efforts {
            with_friction: effort(&self.with_friction, self.tolerance)?,
            without_friction: effort(&self.without_friction, self.tolerance)?,
        })
    }
}

/// A solver's settings, in the words of its own kernel.
fn effort(settings: &Bound<'_, PyDict>, tolerance: f64) -> PyResult<Effort> {
    let item = |name: &str| -> PyResult<Bound<'_, PyAny>> {
        let item = settings.get_item(name)?;
        item.ok_or_else(|| ProblemError::new_err(format!("a native step needs {name:?}")))
    };
    let kernel: String = item("kernel")?.extract()?;
    match kernel.as_str() {
        "gauss_seidel" => {
            let effort: SweepEffort<'_> = settings.extract()?;
            Ok(Effort {
                program: effort.program(item("rows")?.extract()?)?,
                method: Method::Sweeps(effort.settings()),
                tolerance,
            })
        }
        "exact" => {
            let wanted: Wanted = settings.extract()?;
            Ok(Effort {
                program: wanted.law()?.into(),
                method: Method::Exact {
                    method: wanted.method()?,
                    tolerance: wanted.tolerance,
                    max_iterations: wanted.max_iterations,
                    time_limit: wanted.time_limit,
                    presolve: wanted.presolve,
                    threads: wanted.threads,
                },
                tolerance,
            })
        }
        other => Err(ProblemError::new_err(format!(
            "there is no native kernel named {other:?}"
        ))),
    }
}

#[pymethods]
impl Solved {
    /// (n, rows), N s.
    #[getter]
    fn impulse<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.stack.get().0.layout.rows;
        table(py, self.answer.impulse.clone(), rows)
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
            Details::Exact { fallbacks, .. } => fallbacks.clone(),
            _ => Vec::new(),
        }
    }

    /// What presolve did; None where it was not wanted, or found nothing to do.
    #[getter]
    fn presolve(&self) -> Option<PresolveSummary> {
        match &self.answer.details {
            Details::Exact { presolve, .. } => presolve.as_ref().map(presolve_summary),
            _ => None,
        }
    }

    /// The method's own figures.
    #[getter]
    fn extras<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let extras = PyDict::new(py);
        match &self.answer.details {
            Details::Nothing => {}
            Details::Sweeps(stop) => extras.set_item("stopped_by", stop_name(*stop))?,
            Details::Exact {
                factorisations,
                factor_time,
                fill,
                infeasibility,
                ..
            } => {
                extras.set_item("factorisations", factorisations)?;
                extras.set_item("factor_seconds", factor_time.as_secs_f64())?;
                extras.set_item("fill", fill)?;
                if let Some(ray) = infeasibility {
                    let ray: Bound<'py, PyArray1<f64>> = ray.clone().into_pyarray(py);
                    extras.set_item("infeasibility", ray)?;
                }
            }
        }
        Ok(extras)
    }
}
