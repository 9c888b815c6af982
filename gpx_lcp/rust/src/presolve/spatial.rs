//! Islands that keep all velocities of their bodies: contacts without friction keep their normal row, duplicates are one.
//!
//! * Without friction in the whole island no law says anything about tangents: C_i is the normal, (a) to (c) hold for it.
//! * Duplicates, contacts between the same bodies with the same rows of Ĵ, the same B and the same friction, see the same
//!   velocity whatever happens: C_i = I and equal weights satisfy (a) to (c). The impulse comes back in equal parts.

use super::View;
use super::lift::{Columns, LARGEST, Model, Proposal, Share};

/// Propose the rows that matter, and one contact for each set of duplicates.
pub fn propose(view: &View, contacts: &[u32], runs: &[std::ops::Range<usize>]) -> Proposal {
    let frictionless = !contacts.iter().any(|&contact| view.has_friction(contact));
    let rows = if frictionless { 1 } else { view.rows };
    let mut shares: Vec<Share> = Vec::with_capacity(contacts.len());
    let mut sizes: Vec<f64> = Vec::with_capacity(contacts.len());
    for run in runs {
        for place in run.clone() {
            let same = |&other: &usize| same_rows(view, rows, contacts[place], contacts[other]);
            let twin = (run.start..place).find(|other| view.width <= LARGEST && same(other));
            let group = match twin {
                Some(other) => shares[other].group,
                None => {
                    sizes.push(0.0);
                    sizes.len() as u32 - 1
                }
            };
            sizes[group as usize] += 1.0;
            shares.push(Share::whole(group));
        }
    }
    for share in &mut shares {
        share.weight = 1.0 / sizes[share.group as usize];
    }
    Proposal {
        model: if rows < view.rows {
            Model::Frictionless
        } else {
            Model::Spatial
        },
        rows,
        groups: sizes.len(),
        shares,
        columns: Columns::All,
    }
}

/// Whether two of these contacts, sorted by bodies, are the same.
pub fn has_twins(view: &View, contacts: &[u32]) -> bool {
    view.by_pairs(contacts).any(|run| {
        let same = |(at, &one): (usize, &u32)| {
            let mut before = run[..at].iter();
            before.any(|&other| same_rows(view, view.rows, one, other))
        };
        run.iter().enumerate().any(same)
    })
}

/// Whether two contacts between the same bodies are the same in all that matters.
fn same_rows(view: &View, rows: usize, one: u32, other: u32) -> bool {
    let places = view.places(one).zip(view.places(other));
    let mut rows_of =
        places.flat_map(|(a, b)| (0..rows).map(move |row| (view.row(a, row), view.row(b, row))));
    view.target(one)[..rows] == view.target(other)[..rows]
        && view.friction[one as usize] == view.friction[other as usize]
        && rows_of.all(|(a, b)| a == b)
}
