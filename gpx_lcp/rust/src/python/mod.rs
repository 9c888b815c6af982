//! The border to Python: converts arrays, releases the interpreter lock, turns errors into Python's exceptions.

mod part;
mod records;
mod scene;
mod solve;
mod solved;
mod system;
mod world;

use pyo3::prelude::*;

#[pymodule]
mod _core {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::part::Part;
    #[pymodule_export]
    use super::records::{Contacts, Stack};
    #[pymodule_export]
    use super::scene::Bodies;
    #[pymodule_export]
    use super::solve::{Found, admit, solve};
    #[pymodule_export]
    use super::solved::Solved;
    #[pymodule_export]
    use super::system::System;
    #[pymodule_export]
    use super::world::World;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        let profile = if cfg!(debug_assertions) {
            "debug"
        } else {
            "release"
        };
        module.add("BUILD_PROFILE", profile)
    }
}
