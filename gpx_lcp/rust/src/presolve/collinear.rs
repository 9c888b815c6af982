//! Collinear islands, the founding paper's one-dimensional case: one row for a pair of bodies, one velocity for a body.
//!
//! The contacts of a pair become one, with equal weights and the normal for its only row; each body keeps the velocity
//! along the direction in which that row pushes it. With (a) all pushes on a body lie in one direction; with (b) motion in
//! these directions has no tangential part at any contact and closes all those of a pair alike; with (c) all of them have
//! the same to cancel, and nothing along the tangents. Then friction has nothing to do, and the theorem of this folder holds
//! with C_i the normal: a tower of cubes at rest is a column of point masses, a quarter of the load at each corner.

use super::lift::{
    Columns, Direction, Groups, LARGEST, Model, Piece, Proposal, Share, dot, within,
};
use super::local_bodies::LocalBodies;
use super::{ROUNDING, Shaped, View};

/// Of a velocity, what is surely no rounding.
const ROUGH: f64 = 1e-6;

/// The square of a cosine that is one, to rounding.
const PARALLEL: f64 = (1.0 - ROUNDING) * (1.0 - ROUNDING);

/// Whether anything slides before the impulses where there is friction.
pub fn slides(view: &View, contacts: &[u32]) -> bool {
    let still = ROUNDING * view.largest;
    contacts.iter().any(|&contact| {
        let tangents = &view.target(contact)[1..];
        view.has_friction(contact) && tangents.iter().any(|x| x.abs() > still)
    })
}

/// Propose one contact for each run of contacts between the same bodies.
#[inline(always)]
pub fn propose<const R: usize, const D: usize>(
    view: Shaped<R, D>,
    contacts: &[u32],
    runs: &[std::ops::Range<usize>],
    local: &LocalBodies,
) -> Option<Proposal> {
    // Most islands that are not collinear show it here, before anything is worked out.
    if slides(&view, contacts) {
        return None;
    }
    const UNMOVED: Direction = [0.0; LARGEST];
    let mut directions = vec![UNMOVED; local.count()];
    let mut shares = Vec::with_capacity(contacts.len());
    let mut groups = Groups::with_capacity(contacts.len());
    for (group, run) in runs.iter().enumerate() {
        let members = &contacts[run.clone()];
        let weight = 1.0 / members.len() as f64;
        for (slot, &body) in view.bodies_of(members[0]).iter().enumerate() {
            let mut line = [0.0; LARGEST];
            for &member in members {
                let row = view.row(view.places(member).start + slot, 0);
                line[..view.width()]
                    .iter_mut()
                    .zip(row)
                    .for_each(|(sum, value)| *sum += weight * value);
            }
            let line = &mut line[..view.width()];
            let square = dot(line, line);
            if square == 0.0 {
                continue;
            }
            // Condition (b) at one contact, roughly: where it fails, as a rule it fails at the first.
            let first = view.row(view.places(members[0]).start + slot, 0);
            if !within((dot(first, line) - square).abs(), ROUGH * square) {
                return None;
            }
            let known = &mut directions[local.number(body)][..view.width()];
            if known.iter().all(|&value| value == 0.0) {
                let length = square.sqrt();
                known
                    .iter_mut()
                    .zip(line)
                    .for_each(|(known, value)| *known = *value / length);
            } else if dot(known, line).powi(2) < PARALLEL * square {
                return None;
            }
        }
        run.clone().for_each(|index| groups.push(index));
        groups.end();
        shares.extend(members.iter().map(|_| Share {
            weight,
            ..Share::whole(group as u32)
        }));
    }
    Some(Proposal {
        model: Model::Collinear,
        rows: 1,
        pieces: vec![Piece {
            contacts: 0..contacts.len(),
            groups,
            shares,
        }],
        columns: Columns::Some(1, directions),
    })
}
