//! What a native step is told of its solver, and what it solved, as Python sees it.

use pyo3::prelude::*;

use super::records::Stack;
use super::solve::{Found, Wanted};
use crate::stepping::{Efforts, Solved as SolvedData};

/// The last step of a world: the system that it solved, and the answer.
#[pyclass(frozen, get_all, module = "gpx_lcp._core")]
pub struct Solved {
    stack: Py<Stack>,
    found: Py<Found>,
    /// Whether the step was solved as one without friction.
    frictionless: bool,
    /// How far the start impulses had to be moved into their cones, where there were any.
    start_moved: Option<f64>,
}

impl Solved {
    pub fn new(py: Python<'_>, solved: SolvedData) -> PyResult<Self> {
        let found = Found {
            rows: solved.stack.layout.rows,
            answer: solved.answer,
        };
        Ok(Self {
            frictionless: !solved.stack.has_friction(),
            stack: Py::new(py, Stack(solved.stack))?,
            found: Py::new(py, found)?,
            start_moved: solved.start_moved,
        })
    }
}

/// How steps are solved, from a table of settings.
#[derive(FromPyObject)]
pub struct Settings<'py> {
    #[pyo3(item)]
    with_friction: Wanted<'py>,
    #[pyo3(item)]
    without_friction: Wanted<'py>,
}

impl Settings<'_> {
    pub fn efforts(&self) -> PyResult<Efforts> {
        Ok(Efforts {
            with_friction: self.with_friction.effort()?,
            without_friction: self.without_friction.effort()?,
        })
    }
}
