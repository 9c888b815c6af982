//! Exact solvers: second-order methods for the frictionless, the convex and the exact Coulomb law.
//!
//! `active_set`, `interior_point`, `proximal_newton` and a few `sweeps` are the methods; `strategy` runs them one after
//! another. Everything below them is shared: the problem without units and in an order of its own, the cones, the Newton
//! systems and their sparse factorisation.

mod active_set;
mod block_matrix;
mod cones;
mod infeasibility;
mod interior_point;
mod linear;
mod newton_system;
mod order;
mod problem;
mod proximal_newton;
mod small;
mod strategy;
mod sweeps;

pub use block_matrix::{BlockMatrix, ShapeError};
pub use newton_system::Operator;
pub use order::{Contacts, Described, by_bodies};
pub use problem::{Law, Limits, Problem};
pub use small::largest;
pub use strategy::{Method, Report, Status, solve};
