//! Python's way to the exact solvers: the interior point and the proximal Newton method.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use super::system::{PresolveSummary, System, presolve_summary, same_length};
use crate::exact::{Law, Limits, Method, Problem, Report, ShapeError, Status, solve};
use crate::presolve::{self, Summary};
use crate::program::Program;

pyo3::import_exception!(gpx_lcp.errors, ProblemError);

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
    #[pyo3(item)]
    pub presolve: bool,
    #[pyo3(item)]
    pub threads: usize,
}

impl From<Law> for Program {
    fn from(law: Law) -> Self {
        match law {
            Law::Normal => Program::Normal,
            Law::Cone => Program::Cone,
            Law::Coulomb => Program::Coulomb,
        }
    }
}

impl Wanted {
    pub fn law(&self) -> PyResult<Law> {
        law_named(&self.law)
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

pub fn law_named(name: &str) -> PyResult<Law> {
    match name {
        "normal" => Ok(Law::Normal),
        "cone" => Ok(Law::Cone),
        "coulomb" => Ok(Law::Coulomb),
        other => Err(ProblemError::new_err(format!(
            "there is no exact law named {other:?}"
        ))),
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
    factor_seconds: f64,
    fill: usize,
    history: Vec<(usize, f64)>,
    fallbacks: Vec<&'static str>,
    infeasibility: Option<Py<PyArray1<f64>>>,
    solve_seconds: f64,
    /// What presolve did; None where it was not wanted, or found nothing to do.
    presolve: Option<PresolveSummary>,
}

/// Solve a stacked system under one of the laws "normal", "cone" and "coulomb".
#[pyfunction]
pub fn exact(
    py: Python<'_>,
    system: &Bound<'_, System>,
    settings: Wanted,
    start: Option<PyReadonlyArray1<'_, f64>>,
) -> PyResult<ExactReport> {
    let (law, method) = (settings.law()?, settings.method()?);
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
    let (report, solve_seconds, summary) = py.detach(|| -> Result<_, ShapeError> {
        let began = Instant::now();
        if let Some(start) = start {
            let settled = system.settled(&law.into(), start, settings.tolerance, &interrupted);
            if let Some((impulse, residual)) = settled {
                return Ok((Report::unchanged(impulse, residual), began.elapsed(), None));
            }
        }
        let lifted;
        let mut start = start;
        let limits = Limits::new(
            settings.tolerance,
            settings.max_iterations,
            settings.time_limit,
            &interrupted,
        );
        if settings.presolve
            && let Some(found) =
                presolve::solve(&system.view(law), method, &limits, start, settings.threads)
        {
            // Parts that are solved while the whole is not: at tolerances near rounding, the whole has the last word.
            if found.report.status != Status::Solved
                || system.residual_of(&law.into(), &found.report.impulse) <= settings.tolerance
            {
                return Ok((found.report, began.elapsed(), Some(found.summary)));
            }
            lifted = found.report.impulse;
            start = Some(&lifted);
        }
        let operator = system.operator.clone();
        let problem = Problem::new(operator, &system.target, &system.friction, law)?;
        let began = Instant::now();
        let report = solve(&problem, method, &limits, start);
        Ok((report, began.elapsed(), None))
    })?;
    if let Some(signal) = signal.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(signal);
    }
    Ok(answer(
        py,
        report,
        solve_seconds.as_secs_f64(),
        summary.as_ref(),
    ))
}

fn answer(
    py: Python<'_>,
    report: Report,
    solve_seconds: f64,
    summary: Option<&Summary>,
) -> ExactReport {
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
        factor_seconds: report.factor_time.as_secs_f64(),
        fill: report.fill,
        history: report.history,
        fallbacks: report.fallbacks,
        infeasibility: report
            .infeasibility
            .map(|ray| ray.into_pyarray(py).unbind()),
        solve_seconds,
        presolve: summary.map(presolve_summary),
    }
}
