//! The native core of gpx-lcp.
//!
//! Everything numerical lives in plain Rust modules that know nothing of Python; `python` is the only module that does,
//! and it is compiled only with the `python` feature.

#![allow(
    clippy::needless_range_loop,
    reason = "formulas on small matrices read best with their indices"
)]

mod abreast;
pub mod arms;
pub mod bodies;
pub mod collision;
mod colouring;
pub mod contact;
pub mod correction;
pub mod delassus;
pub mod exact;
pub mod explicit;
pub mod factored;
pub mod friction_cone;
pub mod gauss_seidel;
pub mod heading;
pub mod integration;
pub mod lanes;
pub mod mean_motion;
pub mod polygon;
mod pooling;
pub mod presolve;
pub mod program;
pub mod small_matrix;
pub mod solving;
pub mod stacking;
pub mod stepping;
pub mod sweeping;
mod team;
pub mod world;

#[cfg(feature = "python")]
mod python;
