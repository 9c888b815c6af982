//! Planar islands: all motion in one plane, two rows for a contact (one without friction), three velocities for a body.
//!
//! Let e be the normal of the plane. Contacts of a pair that differ by their place along e alone become one, weighted so
//! that their common impulse has no moment out of the plane: the eight corners of two bricks are two contacts. C_i are the
//! normal and the tangent in the plane; V_b is spanned by the two translations in the plane and by the one whitened
//! rotation that the moments of those impulses all have. (a) then says that these impulses move no body out of its plane,
//! which needs a principal axis of inertia along e; (b) that motion in the plane slides no contact along e; (c) that nothing
//! does before the impulses. The theorem of this folder holds, with friction bounded in the plane by the same coefficient.
//!
//! The weights of m contacts at y_i along e, from the plane through the body's centre of mass, are the smallest with Σ w = 1,
//! Σ w y = 0: w_i = (Σ y² − y_i Σ y) / (m Σ y² − (Σ y)²), equal ones where the contacts lie symmetrically.

use std::ops::Range;

use crate::small_matrix::cross;
use crate::team::Team;

use super::lift::{
    Columns, Direction, Groups, LARGEST, Model, Piece, Proposal, Share, size, within,
};
use super::local_bodies::LocalBodies;
use super::{ROUNDING, Shaped};

type Runs<'a> = &'a [Range<usize>];

type Axis = [f64; 3];

/// Of an arm, what is surely no rounding.
const ROUGH: f64 = 1e-6;

/// Contacts of a piece of work, at least: some hundred microseconds.
const PIECE: usize = 256;

/// Normals closer to parallel than this do not tell the plane between them.
const DISTINCT: f64 = 1e-3;

/// Whether normals and sliding of all contacts lie in one plane, and impulses of some, which come by these pairs of bodies,
/// can be balanced in it.
#[inline(always)]
pub fn may_be<const R: usize, const D: usize>(
    view: Shaped<R, D>,
    contacts: &[u32],
    some: &[u32],
    pairs: Runs,
) -> bool {
    Frames::of(view).is_some_and(|frames| {
        let axes = frames.normals_of_plane(contacts);
        let frictionless = frames.is_frictionless(some);
        let balanced = |axis: &Axis| frames.gathered(some, pairs, axis, frictionless).is_some();
        axes.iter().any(balanced)
    })
}

/// Propose each plane that normals and sliding lie in.
#[inline(always)]
pub fn propose<const R: usize, const D: usize>(
    view: Shaped<R, D>,
    contacts: &[u32],
    runs: Runs,
    local: &LocalBodies,
    team: &Team,
) -> impl Iterator<Item = Proposal> {
    Frames::of(view).into_iter().flat_map(move |frames| {
        let candidates = frames.normals_of_plane(contacts);
        let propose = move |axis: Axis| frames.in_plane(contacts, runs, local, &axis, team);
        candidates.into_iter().filter_map(propose)
    })
}

#[derive(Clone, Copy)]
struct Frames<'a, const R: usize, const D: usize> {
    view: Shaped<'a, R, D>,
    jacobian: &'a [f64],
}

impl<'a, const R: usize, const D: usize> Frames<'a, R, D> {
    fn of(view: Shaped<'a, R, D>) -> Option<Self> {
        let jacobian = view.jacobian.filter(|_| matches!(view.width(), 3 | 6))?;
        Some(Self { view, jacobian })
    }

    /// Row `row` of J for the first body of a contact: the direction of the row, and its moment.
    #[inline(always)]
    fn row(&self, contact: u32, row: usize) -> (Axis, Axis) {
        let place = self.view.places(contact).start;
        let line = self.view.line(self.jacobian, place, row);
        ([line[0], line[1], line[2]], moment_of(line))
    }

    /// What the plane can be perpendicular to: two normals that are not parallel decide; beside parallel ones either
    /// tangent may be, if nothing slides along it, and else whatever is perpendicular to the fastest sliding.
    #[inline(always)]
    fn normals_of_plane(&self, contacts: &[u32]) -> Vec<Axis> {
        let moved = |&&contact: &&u32| !self.view.places(contact).is_empty();
        let Some(&first) = contacts.iter().find(moved) else {
            return Vec::new();
        };
        let (normal, _) = self.row(first, 0);
        let mut fastest = (0.0, None);
        for &contact in contacts.iter().filter(moved) {
            let axis = cross(&normal, &self.row(contact, 0).0);
            if dot(&axis, &axis) > DISTINCT * DISTINCT {
                return vec![unit(axis)];
            }
            let tangents = &self.view.target(contact)[1..];
            let square = tangents.iter().map(|x| x * x).sum();
            if square > fastest.0 && self.view.has_friction(contact) {
                fastest = (square, Some(contact));
            }
        }
        let rows = self.view.rows();
        let mut sliding = [0.0; 3];
        if let Some(contact) = fastest.1 {
            for (row, speed) in (1..rows).zip(&self.view.target(contact)[1..]) {
                let (tangent, _) = self.row(contact, row);
                (0..3).for_each(|k| sliding[k] += speed * tangent[k]);
            }
        }
        let hidden = |axis: &Axis| dot(axis, &sliding).abs();
        let axes = (1..rows).map(|row| self.row(first, row).0);
        let slow = ROUNDING * self.view.largest;
        let mut axes: Vec<Axis> = axes.filter(|axis| within(hidden(axis), slow)).collect();
        if axes.is_empty() && rows > 1 {
            axes.push(unit(cross(&normal, &sliding)));
        }
        axes
    }

    fn in_plane(
        &self,
        contacts: &[u32],
        runs: Runs,
        local: &LocalBodies,
        axis: &Axis,
        team: &Team,
    ) -> Option<Proposal> {
        let frictionless = self.is_frictionless(contacts);
        let mut pieces: Vec<_> = stretches(runs).map(|runs| (runs, None)).collect();
        team.each(&mut pieces, |(runs, piece)| {
            *piece = self.gathered(contacts, runs, axis, frictionless);
        });
        let pieces: Vec<Piece> = pieces
            .into_iter()
            .map(|(_, piece)| piece)
            .collect::<Option<_>>()?;
        let columns = self.velocities(contacts, &pieces, local, axis, frictionless, team);
        Some(Proposal {
            model: Model::Planar,
            rows: if frictionless { 1 } else { 2 },
            pieces,
            columns,
        })
    }

    fn is_frictionless(&self, contacts: &[u32]) -> bool {
        !contacts
            .iter()
            .any(|&contact| self.view.has_friction(contact))
    }

    /// The contacts that lie beside each other along the axis, weighed; None where they cannot be.
    #[inline(always)]
    fn gathered(
        &self,
        contacts: &[u32],
        runs: Runs,
        axis: &Axis,
        frictionless: bool,
    ) -> Option<Piece> {
        let begin = runs.first().map_or(0, |run| run.start);
        let end = runs.last().map_or(0, |run| run.end);
        let mut shares: Vec<Share> = Vec::with_capacity(end - begin);
        let mut groups = Groups::with_capacity(end - begin);
        let mut places: Vec<Place> = Vec::new();
        for run in runs {
            places.clear();
            for &contact in &contacts[run.clone()] {
                let place = self.place(contact, axis, !frictionless)?;
                places.push(place);
                shares.push(Share {
                    group: u32::MAX,
                    weight: 1.0,
                    tangent: place.tangent,
                });
            }
            let before = run.start - begin;
            let shares = &mut shares[before..];
            for first in 0..places.len() {
                if shares[first].group != u32::MAX {
                    continue;
                }
                let group = groups.len() as u32;
                for at in first..places.len() {
                    let beside = at == first || places[at].beside(&places[first]);
                    if shares[at].group == u32::MAX && beside {
                        shares[at].group = group;
                        groups.push(before + at);
                    }
                }
                balance(shares, &places, groups.end(), before)?;
            }
        }
        Some(Piece {
            contacts: begin..end,
            groups,
            shares,
        })
    }

    /// Where a contact is, seen along the axis; None where its normal is not in the plane, or it slides out of it.
    #[inline(always)]
    fn place(&self, contact: u32, axis: &Axis, friction: bool) -> Option<Place> {
        let view = self.view;
        if view.places(contact).is_empty() {
            return Some(Place::default());
        }
        let (normal, moment) = self.row(contact, 0);
        let tilt = dot(&normal, axis);
        if !within(tilt * tilt, ROUNDING * ROUNDING * dot(&normal, &normal)) {
            return None;
        }
        let mut tangent = [1.0, 0.0];
        if friction && view.rows() == 3 {
            let (first, second) = (self.row(contact, 1).0, self.row(contact, 2).0);
            // The tangent in the plane is the one without a part along the axis.
            let along = [dot(&first, axis), dot(&second, axis)];
            let length = size(&along);
            if length < 0.5 {
                return None;
            }
            tangent = [along[1] / length, -along[0] / length];
            let target = view.target(contact);
            let hidden = tangent[0] * target[2] - tangent[1] * target[1];
            if !within(hidden.abs(), ROUNDING * view.largest) {
                return None;
            }
        }
        let other = self.view.places(contact).len() > 1;
        let across = cross(&normal, axis);
        let beyond = other.then(|| {
            let line = self
                .view
                .line(self.jacobian, self.view.places(contact).start + 1, 0);
            moment_of(line)
        });
        let beyond = beyond.unwrap_or_default();
        Some(Place {
            normal,
            moment: dot(&moment, axis),
            squared_arms: [&moment, &beyond].map(|moment| dot(moment, moment)),
            along: [-dot(&moment, &across), dot(&beyond, &across)],
            tangent,
        })
    }

    /// Calls `take` with the number of a body, the squared moment and the moment for each row of each group that turns it.
    #[inline(always)]
    fn moments(
        &self,
        contacts: &[u32],
        piece: &Piece,
        local: &LocalBodies,
        rows: usize,
        take: &mut impl FnMut(usize, f64, Axis),
    ) {
        let (view, contacts) = (self.view, &contacts[piece.contacts.clone()]);
        for group in piece.groups.iter() {
            let bodies = view.bodies_of(contacts[group[0] as usize]);
            for (slot, &body) in bodies.iter().enumerate() {
                for row in 0..rows {
                    let mut line = [0.0; LARGEST];
                    for index in group.iter().map(|&index| index as usize) {
                        let place = view.places(contacts[index]).start + slot;
                        let share = &piece.shares[index];
                        share.add_seen(view, place, row, share.weight, &mut line);
                    }
                    let moment = [line[3], line[4], line[5]];
                    let square = dot(&moment, &moment);
                    if square > ROUNDING * ROUNDING * dot(&line, &line) {
                        take(local.number(body), square, moment);
                    }
                }
            }
        }
    }

    /// The translations in the plane, and for each body the whitened rotation of its largest moment.
    #[inline(always)]
    fn velocities(
        &self,
        contacts: &[u32],
        pieces: &[Piece],
        local: &LocalBodies,
        axis: &Axis,
        frictionless: bool,
        team: &Team,
    ) -> Columns {
        let view = self.view;
        let smallest = (0..3).fold(0, |least, k| {
            if axis[k].abs() < axis[least].abs() {
                k
            } else {
                least
            }
        });
        let mut unit_vector = [0.0; 3];
        unit_vector[smallest] = 1.0;
        let across = unit(cross(axis, &unit_vector));
        let along = cross(axis, &across);
        let mut plane: [Direction; 3] = [[0.0; LARGEST]; 3];
        plane[0][..3].copy_from_slice(&along);
        plane[1][..3].copy_from_slice(&across);
        if view.width() == 3 {
            return Columns::Some(2, plane[..2].repeat(local.count()));
        }
        let rows = if frictionless { 1 } else { 2 };
        // The largest moment of each body, and its square.
        let mut turning = vec![(0.0, [0.0; 3]); local.count()];
        let mut take = |number: usize, square: f64, moment: Axis| {
            let (most, direction) = &mut turning[number];
            if square > *most {
                (*most, *direction) = (square, moment);
            }
        };
        if let [piece] = pieces {
            self.moments(contacts, piece, local, rows, &mut take);
        } else {
            let mut found: Vec<_> = pieces.iter().map(|piece| (piece, Vec::new())).collect();
            team.each(&mut found, |(piece, moments)| {
                moments.reserve(2 * rows * piece.groups.len());
                self.moments(
                    contacts,
                    piece,
                    local,
                    rows,
                    &mut |number, square, moment| {
                        moments.push((number, square, moment));
                    },
                );
            });
            for (number, square, moment) in found.into_iter().flat_map(|(_, moments)| moments) {
                take(number, square, moment);
            }
        }
        if turning.iter().all(|(most, _)| *most == 0.0) {
            return Columns::Some(2, plane[..2].repeat(local.count()));
        }
        let mut directions = plane.repeat(local.count());
        for (basis, (most, direction)) in directions.chunks_exact_mut(3).zip(&turning) {
            if *most > 0.0 {
                basis[2][3..].copy_from_slice(&direction.map(|value| value / most.sqrt()));
            }
        }
        Columns::Some(3, directions)
    }
}

/// Runs of contacts in stretches for one thread each.
fn stretches(mut runs: Runs) -> impl Iterator<Item = Runs> {
    std::iter::from_fn(move || {
        let begin = runs.first()?.start;
        let full = |run: &Range<usize>| run.end >= begin + PIECE;
        let count = runs.iter().position(full).map_or(runs.len(), |at| at + 1);
        runs.split_off(..count)
    })
}

/// A contact as seen along the axis.
#[derive(Clone, Copy, Default)]
struct Place {
    normal: Axis,
    /// Of the normal row about the axis, for the first body: which line of the plane it acts in.
    moment: f64,
    /// Of the whole moments about each of the bodies.
    squared_arms: [f64; 2],
    /// y, the place along the axis, from each of the bodies.
    along: [f64; 2],
    tangent: [f64; 2],
}

impl Place {
    /// Whether two contacts of a pair differ by their place along the axis alone.
    fn beside(&self, other: &Self) -> bool {
        let apart = (0..3).any(|k| (self.normal[k] - other.normal[k]).abs() > ROUNDING);
        let (miss, arm) = (self.moment - other.moment, 1e3 * ROUNDING);
        !apart && miss * miss <= arm * arm * self.squared_arms[0].max(other.squared_arms[0])
    }
}

/// Weigh the contacts of a group so that they have no moment out of the plane; None where that takes a negative weight, or
/// cannot be. `members` count from `begin`, where shares and places begin.
fn balance(shares: &mut [Share], places: &[Place], members: &[u32], begin: usize) -> Option<()> {
    let members = || members.iter().map(|&member| member as usize - begin);
    let (mut count, mut sum, mut squares, mut most) = (0.0, 0.0, 0.0, 0.0_f64);
    for place in members().map(|member| &places[member]) {
        let y = place.along[0];
        count += 1.0;
        sum += y;
        squares += y * y;
        most = most.max(y.abs());
    }
    let spread = count * squares - sum * sum;
    let mut middle = [0.0; 2];
    for member in members() {
        let y = places[member].along;
        let symmetric = count == 1.0 || sum.abs() <= ROUNDING * most;
        let weight = if symmetric {
            1.0 / count
        } else {
            (squares - y[0] * sum) / spread
        };
        if weight <= 0.0 {
            return None;
        }
        shares[member].weight = weight;
        (0..2).for_each(|body| middle[body] += weight * y[body]);
    }
    // Most islands that are in no plane show it here: what should be there on the other side of it is not.
    let arms = members().map(|member| places[member].squared_arms);
    let arms = arms.fold([0.0_f64; 2], |most, arms| {
        [0, 1].map(|body| most[body].max(arms[body]))
    });
    let balanced = |body: usize| middle[body] * middle[body] <= ROUGH * ROUGH * arms[body];
    (balanced(0) && balanced(1)).then_some(())
}

/// Of a row of J; none where bodies do not turn.
#[inline(always)]
fn moment_of(line: &[f64]) -> Axis {
    line.get(3..6)
        .map_or([0.0; 3], |moment| [moment[0], moment[1], moment[2]])
}

fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    (0..N).map(|k| a[k] * b[k]).sum()
}

fn unit(a: Axis) -> Axis {
    let length = size(&a);
    a.map(|value| value / length)
}
