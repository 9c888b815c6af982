//! Redundant contacts: kept open by others between the same bodies, and left without impulse.
//!
//! Let contact k and contacts i lie between the same two bodies, with λ_i ≥ 0, Σ λ_i = 1,
//!
//! ```text
//! (a)  Ĵ_k = Σ λ_i Ĵ_i,          x_k in the convex hull of x_i on one plane, or anything else with such rows,
//! (b)  Σ λ_i B_i − B_k ∈ K*_k,    what k is to cancel is no more than what they cancel.
//! ```
//!
//! *Theorem*: without friction at any of them, or under the convex law with one coefficient for all, k may be left out, and
//! p_k = 0. *Proof*: u_k = Σ λ_i u_i + (Σ λ_i B_i − B_k) by (a). Every u_i is in K*, which is the same convex cone at all of
//! them, so that u_k is in it as well: with p_k = 0 the law holds at k, and elsewhere nothing has changed. Conversely, let p
//! solve the whole; p_i + λ_i p_k in the place of p_i and 0 in that of p_k move the bodies as before by (a), stay in the
//! cones, and do no work: p_k·u_k = 0 has two terms that are not negative by (b), hence p_k·u_i = 0 where λ_i > 0. ∎
//!
//! Here the law is asked of the normal alone where there is no friction, and rows and B are those of the normal.
//! Under Coulomb's law friction at k does not vanish with u_k: such contacts stay.
//!
//! The rows of a pair's contacts are points of one affine plane where the contacts lie on one. There the hull is taken, and
//! every point within is written by the three corners of a triangle, or by two on an edge; (a) and (b) are then checked to
//! rounding. The corners carry the load; duplicates of a corner stay, and share with it.

use crate::exact::{Law, largest};

use super::lift::{dot, size, within};
use super::{ROUNDING, View};

/// Leaves redundant contacts out, which are sorted by bodies; returns the most that lie between the same bodies.
pub fn leave_out(view: &View, contacts: &mut Vec<u32>) -> usize {
    let mut out: Vec<u32> = Vec::new();
    let mut most = 0;
    for run in view.by_pairs(contacts) {
        if run.len() < 2 {
            continue;
        }
        let before = out.len();
        if let Some(pair) = Pair::of(view, run) {
            pair.collect_redundant(&mut out);
        }
        most = most.max(out.len() - before);
    }
    if !out.is_empty() {
        out.sort_unstable();
        contacts.retain(|contact| out.binary_search(contact).is_err());
    }
    most
}

/// The contacts of a pair of bodies, by the rows that the law speaks of.
struct Pair<'a> {
    view: &'a View<'a>,
    contacts: &'a [u32],
    rows: usize,
    /// Entries of these rows, contact by contact.
    length: usize,
    points: Vec<f64>,
    /// Of the points, in their affine plane.
    plane: Vec<[f64; 2]>,
}

impl<'a> Pair<'a> {
    /// None where the theorem does not hold, or the points are not in one plane.
    fn of(view: &'a View<'a>, contacts: &'a [u32]) -> Option<Self> {
        let friction = |contact: u32| view.friction[contact as usize];
        let first = contacts[0];
        let rows = if !contacts.iter().any(|&contact| view.has_friction(contact)) {
            1
        } else if view.law == Law::Cone && contacts.iter().all(|&c| friction(c) == friction(first))
        {
            view.rows
        } else {
            return None;
        };
        let length = view.places(first).len() * rows * view.width;
        let mut points = Vec::with_capacity(contacts.len() * length);
        for &contact in contacts {
            for place in view.places(contact) {
                (0..rows).for_each(|row| points.extend_from_slice(view.row(place, row)));
            }
        }
        let plane = in_a_plane(&points, length)?;
        Some(Self {
            view,
            contacts,
            rows,
            length,
            points,
            plane,
        })
    }

    fn collect_redundant(&self, out: &mut Vec<u32>) {
        let hull = hull(&self.plane, |at| self.view.target(self.contacts[at])[0]);
        let (&corner, rest) = hull.split_first().expect("a pair has a contact");
        for (at, &contact) in self.contacts.iter().enumerate() {
            if hull.contains(&at) {
                continue;
            }
            // Triangles from one corner cover the hull; its first and last corner make an edge of two.
            let edge = [[rest.first().copied().unwrap_or(corner); 2]];
            let triangles = rest.windows(2).map(|pair| [pair[0], pair[1]]);
            let mut triangles = triangles.chain(edge.into_iter().filter(|_| rest.len() < 2));
            if triangles.any(|[second, third]| self.kept_open(at, [corner, second, third])) {
                out.push(contact);
            }
        }
    }

    /// Whether (a) and (b) hold for a contact with these corners, and it is none of them over again.
    fn kept_open(&self, at: usize, corners: [usize; 3]) -> bool {
        let share = weights(self.plane[at], corners.map(|corner| self.plane[corner]));
        let Some(share) = share else { return false };
        let point = |at: usize| &self.points[at * self.length..][..self.length];
        let mut miss = point(at).to_vec();
        for (&corner, weight) in corners.iter().zip(share) {
            for (miss, value) in miss.iter_mut().zip(point(corner)) {
                *miss -= weight * value;
            }
        }
        if !within(size(&miss), ROUNDING * size(point(at))) {
            return false;
        }
        let target = |at: usize| &self.view.target(self.contacts[at])[..self.rows];
        let left = (0..self.rows).map(|row| {
            let corners = corners.iter().zip(share);
            corners
                .map(|(&corner, weight)| weight * target(corner)[row])
                .sum::<f64>()
                - target(at)[row]
        });
        let left: Vec<f64> = left.collect();
        let rounding = ROUNDING * self.view.largest;
        let twin = share.contains(&1.0) && size(&left) <= rounding;
        let friction = self.view.friction[self.contacts[at] as usize];
        let sliding = if self.rows > 1 {
            friction * size(&left[1..])
        } else {
            0.0
        };
        !twin && left[0] >= sliding - rounding
    }
}

/// Coordinates of points in the affine plane that they lie in; None where they lie in none.
fn in_a_plane(points: &[f64], length: usize) -> Option<Vec<[f64; 2]>> {
    let first = &points[..length];
    let mut offsets: Vec<f64> = points
        .chunks_exact(length)
        .flat_map(|point| {
            point
                .iter()
                .zip(first)
                .map(|(value, origin)| value - origin)
        })
        .collect();
    let scale = size(first);
    let mut plane = vec![[0.0; 2]; points.len() / length];
    for axis in 0..2 {
        let farthest = offsets
            .chunks_exact(length)
            .max_by(|one, other| dot(one, one).total_cmp(&dot(other, other)))?;
        let reach = size(farthest);
        if reach <= ROUNDING * scale {
            break;
        }
        let direction: Vec<f64> = farthest.iter().map(|value| value / reach).collect();
        for (offset, place) in offsets.chunks_exact_mut(length).zip(&mut plane) {
            place[axis] = dot(offset, &direction);
            for (value, unit) in offset.iter_mut().zip(&direction) {
                *value -= place[axis] * unit;
            }
        }
    }
    offsets
        .chunks_exact(length)
        .all(|offset| within(size(offset), ROUNDING * scale))
        .then_some(plane)
}

/// Corners of the convex hull, against the clock (Andrew's monotone chain); of equal points the first has the most to
/// cancel.
fn hull(points: &[[f64; 2]], target: impl Fn(usize) -> f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&one, &other| {
        let place = |at: usize| points[at];
        let along = place(one)[0].total_cmp(&place(other)[0]);
        let across = place(one)[1].total_cmp(&place(other)[1]);
        along
            .then(across)
            .then(target(other).total_cmp(&target(one)))
    });
    order.dedup_by(|later, first| points[*later] == points[*first]);
    if order.len() < 3 {
        return order;
    }
    // What turns by rounding alone is straight.
    let extent = largest(points.as_flattened());
    let straight = ROUNDING * extent * extent;
    let half = |points_in_order: &mut dyn Iterator<Item = usize>| {
        let mut chain: Vec<usize> = Vec::new();
        for at in points_in_order {
            while let [.., before, last] = chain[..]
                && turn(points[before], points[last], points[at]) <= straight
            {
                chain.pop();
            }
            chain.push(at);
        }
        chain.pop();
        chain
    };
    let mut corners = half(&mut order.iter().copied());
    corners.extend(half(&mut order.iter().rev().copied()));
    corners
}

/// Twice the area of a triangle, positive against the clock.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// The weights of three corners that make a point of their triangle, its edges or its ends; None outside.
fn weights(point: [f64; 2], [a, b, c]: [[f64; 2]; 3]) -> Option<[f64; 3]> {
    let area = turn(a, b, c);
    let raw = if area > 0.0 {
        [
            turn(b, c, point) / area,
            turn(c, a, point) / area,
            turn(a, b, point) / area,
        ]
    } else {
        let edge = [b[0] - a[0], b[1] - a[1]];
        let square = dot(&edge, &edge);
        let along = if square > 0.0 {
            dot(&edge, &[point[0] - a[0], point[1] - a[1]]) / square
        } else {
            0.0
        };
        [1.0 - along, along, 0.0]
    };
    if raw.iter().any(|&weight| !within(-weight, ROUNDING)) {
        return None;
    }
    // What is rounding is none, so that an end is an end.
    let clean = raw.map(|weight| if weight <= ROUNDING { 0.0 } else { weight });
    let sum: f64 = clean.iter().sum();
    Some(clean.map(|weight| weight / sum))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [[f64; 2]; 6] = [
        [0.0, 0.0],
        [2.0, 0.0],
        [2.0, 2.0],
        [0.0, 2.0],
        [1.0, 1.0],
        [1.0, 0.0],
    ];

    #[test]
    fn corners_of_a_square_are_those_of_its_hull() {
        let mut corners = hull(&SQUARE, |_| 0.0);
        corners.sort_unstable();
        assert_eq!(corners, [0, 1, 2, 3]);
    }

    #[test]
    fn a_hull_of_one_place_has_the_point_with_the_most_to_cancel() {
        let targets = [1.0, 3.0, 2.0];
        assert_eq!(hull(&[[1.0, 1.0]; 3], |at| targets[at]), [1]);
    }

    #[test]
    fn weights_make_the_point() {
        let corners = [SQUARE[0], SQUARE[1], SQUARE[2]];
        assert_eq!(weights([1.5, 0.5], corners), Some([0.25, 0.5, 0.25]));
        assert_eq!(weights([0.5, 1.5], corners), None);
        assert_eq!(
            weights([0.5, 0.0], [SQUARE[0], SQUARE[1], SQUARE[1]]),
            Some([0.75, 0.25, 0.0])
        );
    }

    #[test]
    fn points_in_space_lie_in_no_plane() {
        let tetrahedron = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        assert!(in_a_plane(&tetrahedron, 3).is_none());
        assert!(in_a_plane(&tetrahedron[..9], 3).is_some());
    }
}
