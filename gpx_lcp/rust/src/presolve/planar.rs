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

use super::lift::{Basis, Columns, Groups, LARGEST, Model, Proposal, Share, size, within};
use super::local_bodies::LocalBodies;
use super::{ROUNDING, View};

type Axis = [f64; 3];

/// Normals closer to parallel than this do not tell the plane between them.
const DISTINCT: f64 = 1e-3;

/// Whether normals and sliding of contacts with friction lie in one plane.
pub fn may_be(view: &View, contacts: &[u32]) -> bool {
    Frames::of(view).is_some_and(|frames| {
        let axes = frames.normals_of_plane(contacts).unwrap_or_default();
        let within = |axis: &Axis| {
            let mut contacts = contacts.iter();
            contacts.all(|&contact| frames.place(contact, axis, true).is_some())
        };
        axes.iter().any(within)
    })
}

/// Propose each plane that normals and sliding lie in.
pub fn propose(
    view: &View,
    contacts: &[u32],
    runs: &[std::ops::Range<usize>],
    local: &LocalBodies,
) -> impl Iterator<Item = Proposal> {
    let frame = Frames::of(view);
    frame.into_iter().flat_map(move |frame| {
        let candidates = frame.normals_of_plane(contacts).unwrap_or_default();
        let propose = move |axis: Axis| frame.in_plane(contacts, runs, local, &axis);
        candidates.into_iter().filter_map(propose)
    })
}

struct Frames<'a> {
    view: &'a View<'a>,
    jacobian: &'a [f64],
}

impl<'a> Frames<'a> {
    fn of(view: &'a View<'a>) -> Option<Self> {
        let jacobian = view.jacobian.filter(|_| matches!(view.width, 3 | 6))?;
        Some(Self { view, jacobian })
    }

    /// Row `row` of J for the first body of a contact: the direction of the row, and its moment.
    fn row(&self, contact: u32, row: usize) -> (Axis, Axis) {
        let View { rows, width, .. } = *self.view;
        let place = self.view.places(contact).start;
        let line = &self.jacobian[(place * rows + row) * width..][..width];
        let moment = if width == 6 {
            [line[3], line[4], line[5]]
        } else {
            [0.0; 3]
        };
        ([line[0], line[1], line[2]], moment)
    }

    /// What the plane can be perpendicular to: two normals that are not parallel decide; beside parallel ones either
    /// tangent may be, and at last whatever is perpendicular to the fastest sliding.
    fn normals_of_plane(&self, contacts: &[u32]) -> Option<Vec<Axis>> {
        let moved = |&&contact: &&u32| !self.view.places(contact).is_empty();
        let first = *contacts.iter().find(moved)?;
        let (normal, _) = self.row(first, 0);
        for &contact in contacts.iter().filter(moved) {
            let axis = cross(&normal, &self.row(contact, 0).0);
            if size(&axis) > DISTINCT {
                return Some(vec![unit(axis)]);
            }
        }
        let rows = self.view.rows;
        let mut axes: Vec<Axis> = (1..rows).map(|row| self.row(first, row).0).collect();
        let mut fastest = (DISTINCT * self.view.largest, [0.0; 3]);
        for &contact in contacts.iter().filter(moved) {
            let target = self.view.target(contact);
            let speed = size(&target[1..]);
            if speed > fastest.0 {
                let mut sliding = [0.0; 3];
                for row in 1..rows {
                    let (tangent, _) = self.row(contact, row);
                    (0..3).for_each(|k| sliding[k] += target[row] / speed * tangent[k]);
                }
                fastest = (speed, cross(&normal, &sliding));
            }
        }
        if size(&fastest.1) > 0.0 {
            axes.push(unit(fastest.1));
        }
        Some(axes)
    }

    fn in_plane(
        &self,
        contacts: &[u32],
        runs: &[std::ops::Range<usize>],
        local: &LocalBodies,
        axis: &Axis,
    ) -> Option<Proposal> {
        let view = self.view;
        let frictionless = !contacts.iter().any(|&contact| view.has_friction(contact));
        let mut shares: Vec<Share> = Vec::with_capacity(contacts.len());
        let mut groups = 0_u32;
        let mut places: Vec<Place> = Vec::new();
        for run in runs {
            places.clear();
            for &contact in &contacts[run.clone()] {
                places.push(self.place(contact, axis, !frictionless)?);
            }
            let first = groups;
            for (at, place) in places.iter().enumerate() {
                let twin = (0..at).find(|&other| places[other].beside(place));
                let group = twin.map_or(groups, |other| shares[run.start + other].group);
                groups = groups.max(group + 1);
                shares.push(Share {
                    group,
                    weight: 1.0,
                    tangent: place.tangent,
                });
            }
            for group in first..groups {
                balance(&mut shares[run.clone()], &places, group)?;
            }
        }
        let columns = self.velocities(
            contacts,
            &shares,
            groups as usize,
            local,
            axis,
            frictionless,
        );
        Some(Proposal {
            model: Model::Planar,
            rows: if frictionless { 1 } else { 2 },
            groups: groups as usize,
            shares,
            columns,
        })
    }

    /// Where a contact is, seen along the axis; None where its normal is not in the plane, or it slides out of it.
    fn place(&self, contact: u32, axis: &Axis, friction: bool) -> Option<Place> {
        let view = self.view;
        if view.places(contact).is_empty() {
            return Some(Place::default());
        }
        let (normal, moment) = self.row(contact, 0);
        if !within(dot(&normal, axis).abs(), ROUNDING * size(&normal)) {
            return None;
        }
        let mut tangent = [1.0, 0.0];
        if friction && view.rows == 3 {
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
        Some(Place {
            normal,
            moment: dot(&moment, axis),
            arm: size(&moment),
            along: -dot(&moment, &cross(&normal, axis)),
            tangent,
        })
    }

    /// The translations in the plane, and for each body the whitened rotation of its largest moment.
    fn velocities(
        &self,
        contacts: &[u32],
        shares: &[Share],
        groups: usize,
        local: &LocalBodies,
        axis: &Axis,
        frictionless: bool,
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
        let mut basis: Basis = [[0.0; LARGEST]; 3];
        basis[0][..3].copy_from_slice(&along);
        basis[1][..3].copy_from_slice(&across);
        let mut bases = vec![basis; local.count()];
        if view.width == 3 {
            return Columns::Some(2, bases);
        }
        let rows = if frictionless { 1 } else { 2 };
        let mut turning = vec![(0.0, [0.0; 3]); local.count()];
        let groups = Groups::of(shares, groups);
        for group in groups.iter() {
            for (slot, &body) in view
                .bodies_of(contacts[group[0] as usize])
                .iter()
                .enumerate()
            {
                for row in 0..rows {
                    let mut line = [0.0; LARGEST];
                    for index in group.iter().map(|&index| index as usize) {
                        let place = view.places(contacts[index]).start + slot;
                        shares[index].add_seen(view, place, row, shares[index].weight, &mut line);
                    }
                    let moment = [line[3], line[4], line[5]];
                    let length = size(&moment);
                    let (most, direction) = &mut turning[local.number(body)];
                    if length > *most && length > ROUNDING * size(&line) {
                        (*most, *direction) = (length, moment);
                    }
                }
            }
        }
        if turning.iter().all(|(most, _)| *most == 0.0) {
            return Columns::Some(2, bases);
        }
        for (basis, (most, direction)) in bases.iter_mut().zip(&turning) {
            if *most > 0.0 {
                (0..3).for_each(|k| basis[2][3 + k] = direction[k] / most);
            }
        }
        Columns::Some(3, bases)
    }
}

/// A contact as seen along the axis.
#[derive(Clone, Copy, Default)]
struct Place {
    normal: Axis,
    /// Of the normal row about the axis, for the first body: which line of the plane it acts in.
    moment: f64,
    /// The size of the whole moment.
    arm: f64,
    /// y, the place along the axis.
    along: f64,
    tangent: [f64; 2],
}

impl Place {
    /// Whether two contacts of a pair differ by their place along the axis alone.
    fn beside(&self, other: &Self) -> bool {
        let apart = (0..3).any(|k| (self.normal[k] - other.normal[k]).abs() > ROUNDING);
        let arm = 1e3 * ROUNDING * self.arm.max(other.arm);
        !apart && (self.moment - other.moment).abs() <= arm
    }
}

/// Weigh the contacts of a group so that they have no moment out of the plane; None where that takes a negative weight.
fn balance(shares: &mut [Share], places: &[Place], group: u32) -> Option<()> {
    let (mut count, mut sum, mut squares, mut most) = (0.0, 0.0, 0.0, 0.0_f64);
    for (_, place) in shares
        .iter()
        .zip(places)
        .filter(|(share, _)| share.group == group)
    {
        let y = place.along;
        count += 1.0;
        sum += y;
        squares += y * y;
        most = most.max(y.abs());
    }
    let spread = count * squares - sum * sum;
    for (share, place) in shares
        .iter_mut()
        .zip(places)
        .filter(|(share, _)| share.group == group)
    {
        let symmetric = count == 1.0 || sum.abs() <= ROUNDING * most;
        share.weight = if symmetric {
            1.0 / count
        } else {
            (squares - place.along * sum) / spread
        };
        if share.weight <= 0.0 {
            return None;
        }
    }
    Some(())
}

fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    (0..N).map(|k| a[k] * b[k]).sum()
}

fn cross(a: &Axis, b: &Axis) -> Axis {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn unit(a: Axis) -> Axis {
    let length = size(&a);
    a.map(|value| value / length)
}
