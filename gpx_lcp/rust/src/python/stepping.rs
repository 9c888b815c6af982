//! Python's way to the native step: many steps in one call.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use numpy::{IntoPyArray, PyArray1, PyArray2};
use parry3d_f64::math::Vector;
use pyo3::exceptions::PyBaseException;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::exact::Wanted;
use super::gauss_seidel::{Effort as SweepEffort, stop_name};
use super::records::{Contacts, ProblemError, Stack, State, Table, same_length, table};
use super::scene::{Bodies, detection_failed, layout};
use super::system::{PresolveSummary, presolve_summary};
use crate::solving::{Answer, Details, Effort, Method, Status};
use crate::stepping::{Conditions, Failure, Loads, Step as StepData, step};

/// How often a call looks for signals.
const POLL_EVERY: Duration = Duration::from_millis(50);

/// What holds during the steps of one call.
#[derive(FromPyObject)]
pub struct Asked<'py> {
    #[pyo3(item)]
    time_step: f64,
    #[pyo3(item)]
    gravity: [f64; 3],
    #[pyo3(item)]
    impact_speed: f64,
    #[pyo3(item)]
    forces: Table<'py>,
    #[pyo3(item)]
    rows: usize,
    #[pyo3(item)]
    columns: usize,
    #[pyo3(item)]
    tolerance: f64,
    #[pyo3(item)]
    with_friction: Bound<'py, PyDict>,
    #[pyo3(item)]
    without_friction: Bound<'py, PyDict>,
    #[pyo3(item)]
    warm_start: bool,
}

/// The last step of a call: the state it left, the system it solved, and the answer.
#[pyclass(frozen, module = "gpx_lcp._core")]
pub struct Step {
    #[pyo3(get)]
    state: Py<State>,
    #[pyo3(get)]
    contacts: Py<Contacts>,
    #[pyo3(get)]
    stack: Py<Stack>,
    answer: Answer,
    /// Whether the step was solved as one without friction.
    #[pyo3(get)]
    frictionless: bool,
    #[pyo3(get)]
    start_moved: Option<f64>,
    /// Steps taken by the call, and how many of them were not solved to the tolerance.
    #[pyo3(get)]
    steps: usize,
    #[pyo3(get)]
    unsolved: usize,
}

/// Take `count` steps from `state`; the impulses of the step before, rows per contact, start the first.
///
/// Returns the last whole step (None where there is none), the index of the body whose state is not finite after the
/// next step, and any other error of that step.
#[pyfunction]
#[pyo3(signature = (bodies, state, contacts, impulse, asked, count))]
#[allow(clippy::type_complexity)]
pub fn take_steps(
    py: Python<'_>,
    bodies: &Bodies,
    state: &State,
    contacts: Option<&Contacts>,
    impulse: Table<'_>,
    asked: Asked<'_>,
    count: usize,
) -> PyResult<(Option<Step>, Option<usize>, Option<Py<PyBaseException>>)> {
    bodies.check_state(state)?;
    let conditions = Conditions {
        time_step: asked.time_step,
        gravity: Vector::from_array(asked.gravity),
        impact_speed: asked.impact_speed,
        forces: bodies.twists("forces", &asked.forces)?,
        layout: layout(asked.rows, asked.columns)?,
        with_friction: effort(&asked.with_friction, asked.tolerance)?,
        without_friction: effort(&asked.without_friction, asked.tolerance)?,
        warm_start: asked.warm_start,
    };
    let impulse = impulse.as_slice()?;
    let before = contacts.map_or(0, |contacts| contacts.contacts.len());
    same_length("impulse", impulse.len(), before * asked.rows)?;
    let signals = Signals::new();
    let interrupted = || signals.seen();
    let (last, taken, unsolved, failure) = py.detach(|| {
        let (mut last, mut next) = (StepData::default(), StepData::default());
        let (mut taken, mut unsolved) = (0, 0);
        let mut failure = None;
        while taken < count {
            let (before, from) = if taken > 0 {
                (
                    &last.state,
                    Some((last.contacts.as_slice(), last.answer.impulse.as_slice())),
                )
            } else {
                (
                    &state.0,
                    contacts.map(|contacts| (contacts.contacts.as_slice(), impulse)),
                )
            };
            let loads = from.map(|(contacts, impulse)| Loads { contacts, impulse });
            let result = step(
                &bodies.0,
                &conditions,
                before,
                loads,
                &mut next,
                &interrupted,
            );
            if let Err(reason) = result {
                failure = Some(reason);
                break;
            }
            std::mem::swap(&mut last, &mut next);
            taken += 1;
            unsolved += usize::from(last.answer.status != Status::Solved);
            if interrupted() {
                failure = Some(Failure::Interrupted);
                break;
            }
        }
        (last, taken, unsolved, failure)
    });
    let (body, error) = match failure {
        None => (None, None),
        Some(Failure::NotFinite(body)) => (Some(body), None),
        Some(Failure::Detection) => (None, Some(detection_failed())),
        Some(Failure::Interrupted) => (None, signals.into_error()),
    };
    let stepped = match taken {
        0 => None,
        _ => Some(Step {
            state: Py::new(py, State(last.state))?,
            contacts: Py::new(py, Contacts::new(&bodies.0, last.contacts))?,
            frictionless: !last.stack.has_friction(),
            stack: Py::new(py, Stack(last.stack))?,
            answer: last.answer,
            start_moved: last.start_moved,
            steps: taken,
            unsolved,
        }),
    };
    Ok((stepped, body, error.map(|error| error.into_value(py))))
}

/// Python's signals, looked for every 50 ms; the first one is kept.
struct Signals(Mutex<(Instant, Option<PyErr>)>);

impl Signals {
    fn new() -> Self {
        Self(Mutex::new((Instant::now(), None)))
    }

    fn seen(&self) -> bool {
        let mut watch = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (polled, signal) = &mut *watch;
        if signal.is_none() && polled.elapsed() >= POLL_EVERY {
            *polled = Instant::now();
            *signal = Python::attach(|py| py.check_signals()).err();
        }
        signal.is_some()
    }

    fn into_error(self) -> Option<PyErr> {
        let watch = self.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        watch.1
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
impl Step {
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
