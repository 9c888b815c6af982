//! Islands that keep all velocities of their bodies: contacts without friction keep their normal row, duplicates are one.
//!
//! * Without friction in the whole island no law says anything about tangents: C_i is the normal, (a) to (c) hold for it.
//! * Duplicates, contacts between the same bodies with the same rows of Ĵ, the same B and the same friction, see the same
//!   velocity whatever happens: C_i = I and equal weights satisfy (a) to (c). The impulse comes back in equal parts.

use super::Shaped;
use super::lift::{Columns, Groups, LARGEST, Model, Piece, Proposal, Share};

/// Propose the rows that matter, and one contact for each set of duplicates.
pub fn propose<const R: usize, const D: usize>(
    view: Shaped<R, D>,
    contacts: &[u32],
    runs: &[std::ops::Range<usize>],
) -> Proposal {
    let frictionless = !contacts.iter().any(|&contact| view.has_friction(contact));
    let rows = if frictionless { 1 } else { view.rows() };
    let mut shares: Vec<Share> = Vec::with_capacity(contacts.len());
    let mut groups = Groups::with_capacity(contacts.len());
    for run in runs {
        let mut begin = run.start;
        for end in run.start + 1..=run.end {
            // Contacts are in order, duplicates beside each other.
            let goes_on = end < run.end
                && view.width() <= LARGEST
                && same_rows(view, rows, contacts[end - 1], contacts[end]);
            if goes_on {
                continue;
            }
            let share = Share {
                weight: 1.0 / (end - begin) as f64,
                ..Share::whole(groups.len() as u32)
            };
            (begin..end).for_each(|index| groups.push(index));
            groups.end();
            shares.resize(end, share);
            begin = end;
        }
    }
    Proposal {
        model: if rows < view.rows() {
            Model::Frictionless
        } else {
            Model::Spatial
        },
        rows,
        pieces: vec![Piece {
            contacts: 0..contacts.len(),
            groups,
            shares,
        }],
        columns: Columns::All,
    }
}

/// Whether the first rows of two of these contacts, sorted by bodies, are the same.
#[inline(always)]
pub fn has_twins<const R: usize, const D: usize>(
    view: Shaped<R, D>,
    contacts: &[u32],
    rows: usize,
) -> bool {
    view.by_pairs(contacts).any(|run| {
        let same = |(at, &one): (usize, &u32)| {
            let mut before = run[..at].iter();
            before.any(|&other| same_rows(view, rows, one, other))
        };
        run.iter().enumerate().any(same)
    })
}

/// Whether two contacts between the same bodies are the same in all that matters.
#[inline(always)]
fn same_rows<const R: usize, const D: usize>(
    view: Shaped<R, D>,
    rows: usize,
    one: u32,
    other: u32,
) -> bool {
    let mut places = view.places(one).zip(view.places(other));
    // Most differ by the arm of the normal.
    places.all(|(a, b)| (0..rows).all(|row| view.row(a, row) == view.row(b, row)))
        && view.target(one)[..rows] == view.target(other)[..rows]
        && view.friction[one as usize] == view.friction[other as usize]
}
