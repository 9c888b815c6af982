//! Translational islands: point masses, and bodies whose contacts push through their centres of mass.
//!
//! Where the rows in the law have no entry beyond the first three velocities of a body, the others get no impulse and are
//! seen by no contact: V is spanned by the first three, (a) and (b) hold because Ĵ_i Q Qᵀ = Ĵ_i, (c) because C_i = I or,
//! without friction, the normal. Frictionless spheres are the common case.

use super::lift::{Columns, Direction, LARGEST, Model, Proposal, WIDEST, dot};
use super::local_bodies::LocalBodies;
use super::{ROUNDING, Shaped};

/// Whether bodies rotate, and the first rows of no contact turn any.
#[inline(always)]
pub fn may_be<const R: usize, const D: usize>(
    view: Shaped<R, D>,
    contacts: &[u32],
    rows: usize,
) -> bool {
    let turns = |&contact: &u32| {
        view.places(contact).any(|place| {
            (0..rows).any(|row| {
                let line = view.row(place, row);
                let (turning, bound) = (&line[WIDEST..], ROUNDING * ROUNDING * dot(line, line));
                dot(turning, turning) > bound
            })
        })
    };
    view.width() > WIDEST && view.width() <= LARGEST && !contacts.iter().any(turns)
}

/// Take a proposal that keeps all velocities, and keep the translations.
#[inline(always)]
pub fn propose<const R: usize, const D: usize>(
    view: Shaped<R, D>,
    contacts: &[u32],
    local: &LocalBodies,
    all: Proposal,
) -> Proposal {
    if !may_be(view, contacts, all.rows) {
        return all;
    }
    let mut translations: [Direction; WIDEST] = [[0.0; LARGEST]; WIDEST];
    (0..WIDEST).for_each(|axis| translations[axis][axis] = 1.0);
    Proposal {
        model: Model::Translational,
        columns: Columns::Some(WIDEST, translations.repeat(local.count())),
        ..all
    }
}
