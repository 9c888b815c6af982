//! Presolve: the smallest stacked systems with the same answer, solved in the place of the one that was asked, and the
//! way back to its impulses.
//!
//! # What makes a reduction exact
//!
//! Contacts i are gathered in groups g, each with weights w_i > 0 that add up to one and frames C_i (rows × R, orthonormal
//! columns, the first of them the normal), and every body b gets a subspace V_b of its whitened velocities with an
//! orthonormal basis Q_b. The reduced system has one contact for each group,
//!
//! ```text
//! J'_g = Σ_i w_i C_iᵀ Ĵ_i Q,    A' = J' J'ᵀ,    B'_g = Σ_i w_i C_iᵀ B_i,    μ'_g = μ_i,
//! ```
//!
//! and its impulses q are lifted to p_i = w_i C_i q_g. If
//!
//! ```text
//! (a)  Σ_i w_i C_iᵀ Ĵ_i = J'_g Qᵀ        forces stay within V,
//! (b)  Ĵ_i Q = C_i J'_g                   so that velocities in V look the same from every contact of a group,
//! (c)  B_i = C_i B'_g                     and so does what they are to cancel,
//! ```
//!
//! then p solves the system exactly where q solves the reduced one. *Proof*: Ĵᵀ p = Σ_g (Σ_i w_i C_iᵀ Ĵ_i)ᵀ q_g = Q J'ᵀ q by
//! (a), hence u_i = Ĵ_i Q J'ᵀ q − B_i = C_i (J'_g J'ᵀ q − B'_g) = C_i u'_g by (b) and (c). C_i keeps lengths and the normal,
//! and the laws of contact (frictionless, convex, Coulomb's) are isotropic and do not change when impulses are multiplied
//! by w_i > 0: they hold for (p_i, u_i) exactly where they hold for (q_g, u'_g). ∎
//!
//! Where a contact has no friction its tangential rows appear in no law: (b) and (c) are then asked of the normal alone,
//! and the velocities along the tangents are what they are.
//!
//! A convex law has one velocity, so that it is the same with and without presolve. Coulomb's law may have several exact
//! solutions; then presolve may choose another one of them.
//!
//! `islands` cuts the system apart, `resting` leaves those alone that start from a solution, `inactive` leaves out
//! contacts that no solution pushes shut and `redundant` those that others keep open, each by a theorem of its own.
//! `collinear`, `planar`, `translational` and `spatial` each propose groups, frames and subspaces for an island, the
//! smallest first, and `lift` puts the proposal to (a), (b) and (c), whoever made it: what fails by more than rounding
//! is not reduced. `single` and `chain` need no iteration at all, and `remembered` keeps what they were found by for
//! the next step. Of a system given by A, islands, inactive contacts, rows without friction and single contacts are
//! read from its blocks.

mod chain;
mod collinear;
mod delassus;
mod inactive;
mod islands;
mod lift;
mod local_bodies;
mod parts;
mod planar;
mod redundant;
mod remembered;
mod resting;
mod single;
mod spatial;
mod translational;

pub use inactive::any_apart;
pub use islands::all_islands;
pub use lift::{Model, Part, fair_share, size};
pub use parts::{
    Found, Reduced, Size, Summary, as_they_are, each, reduce, summary, together, unreduced,
};
pub use remembered::Remembered;
pub use resting::{Resting, Rests};

use crate::exact::{Contacts, Described, Law};

/// What is rounding: of rows of Ĵ relative to their length, of B relative to its largest entry.
const ROUNDING: f64 = 1e-12;

/// What a system is given by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// Ĵ, with A = Ĵ Ĵᵀ.
    Velocity,
    /// A alone. Each contact is the one body that its column of A stands for.
    Impulse,
}

/// How bodies move before any contact impulse.
#[derive(Clone, Default)]
pub struct FreeMotion {
    /// Width numbers for each body.
    velocity: Vec<f64>,
    /// v·M v of each body.
    energies: Vec<f64>,
}

/// A stacked system, as the reductions read it.
#[derive(Clone, Copy)]
pub struct View<'a> {
    pub form: Form,
    /// Rows per contact, the normal first.
    pub rows: usize,
    /// Velocities per body; rows, where A is all there is.
    pub width: usize,
    pub bodies: usize,
    pub starts: &'a [usize],
    pub columns: &'a [u32],
    /// Blocks of Ĵ, rows × width each, or of A, its columns rising and its pattern symmetric.
    pub whitened: &'a [f64],
    /// Blocks of J, where bodies have three translations, in an orthonormal frame that is the same for all, and then
    /// rotations or none. Only the recognition of planes needs them.
    pub jacobian: Option<&'a [f64]>,
    /// Where it is known, for contacts that are apart.
    pub free: Option<&'a FreeMotion>,
    pub b: &'a [f64],
    /// Of B, what velocities are measured against.
    pub largest: f64,
    pub friction: &'a [f64],
    pub law: Law,
    /// Whether sweeps solve it, which need no tangents where there is no friction.
    pub swept: bool,
}

impl<'a> View<'a> {
    pub fn contacts(&self) -> usize {
        self.friction.len()
    }

    /// The contacts, to be compared.
    fn described(&self) -> Contacts<'a> {
        Contacts::new(Described {
            starts: self.starts,
            columns: self.columns,
            values: self.whitened,
            area: self.rows * self.width,
            of_bodies: self.form == Form::Velocity,
            b: self.b,
            friction: self.friction,
        })
    }

    /// The blocks of a contact, by their place.
    #[inline(always)]
    fn places(&self, contact: u32) -> std::ops::Range<usize> {
        self.starts[contact as usize]..self.starts[contact as usize + 1]
    }

    #[inline(always)]
    fn bodies_of(&self, contact: u32) -> &'a [u32] {
        &self.columns[self.places(contact)]
    }

    /// Contacts that are sorted by bodies, those of the same bodies at a time.
    fn by_pairs<'b>(&self, contacts: &'b [u32]) -> impl Iterator<Item = &'b [u32]> {
        contacts.chunk_by(|&one, &other| self.bodies_of(one) == self.bodies_of(other))
    }

    /// One row of a block of Ĵ.
    #[inline(always)]
    fn row(&self, place: usize, row: usize) -> &'a [f64] {
        &self.whitened[(place * self.rows + row) * self.width..][..self.width]
    }

    #[inline(always)]
    fn target(&self, contact: u32) -> &'a [f64] {
        &self.b[contact as usize * self.rows..][..self.rows]
    }

    /// Whether the law says something about the tangents of this contact.
    fn has_friction(&self, contact: u32) -> bool {
        self.law != Law::Normal && self.rows > 1 && self.friction[contact as usize] > 0.0
    }
}

/// A view with blocks of a size that is known when compiled; zeros stand for any other.
#[derive(Clone, Copy)]
pub struct Shaped<'a, const ROWS: usize, const WIDTH: usize>(&'a View<'a>);

impl<'a, const ROWS: usize, const WIDTH: usize> std::ops::Deref for Shaped<'a, ROWS, WIDTH> {
    type Target = View<'a>;

    #[inline(always)]
    fn deref(&self) -> &View<'a> {
        self.0
    }
}

impl<'a, const ROWS: usize, const WIDTH: usize> Shaped<'a, ROWS, WIDTH> {
    #[inline(always)]
    fn rows(&self) -> usize {
        if ROWS > 0 { ROWS } else { self.0.rows }
    }

    #[inline(always)]
    fn width(&self) -> usize {
        if WIDTH > 0 { WIDTH } else { self.0.width }
    }

    /// One row of a block of Ĵ.
    #[inline(always)]
    fn row(&self, place: usize, row: usize) -> &'a [f64] {
        self.line(self.0.whitened, place, row)
    }

    /// One row of a block of Ĵ or J.
    #[inline(always)]
    fn line(&self, blocks: &'a [f64], place: usize, row: usize) -> &'a [f64] {
        &blocks[(place * self.rows() + row) * self.width()..][..self.width()]
    }

    #[inline(always)]
    fn target(&self, contact: u32) -> &'a [f64] {
        &self.0.b[contact as usize * self.rows()..][..self.rows()]
    }
}
