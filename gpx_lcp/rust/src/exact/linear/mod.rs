//! Sparse linear algebra of the Newton systems: dense blocks on the contact graph, factored front by front.

mod dense;
mod multifrontal;
mod ordering;
mod symbolic;

pub use multifrontal::BlockLu;
