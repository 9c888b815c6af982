//! The native core of gpx-lcp.
//!
//! Everything numerical lives in plain Rust modules that know nothing of Python; `python` is the only module that does,
//! and it is compiled only with the `python` feature.

#[cfg(feature = "python")]
mod python;
