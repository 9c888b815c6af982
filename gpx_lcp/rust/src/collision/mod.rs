//! From poses to contacts: which bodies may touch within the step, and where.
//!
//! The broad phase tries boxes that are as much wider as the body can travel in the step; the narrow phase makes one
//! manifold per pair that is left. Nothing that is carried over from one step to the next changes a result, so that the
//! same state always gives the same contacts; what touches is named by features, which is what lets the impulses of one
//! step start the next.

pub mod broad_phase;
pub mod manifold;
pub mod separation;
pub mod solid;

use std::mem::swap;

use parry3d_f64::math::{Pose, Vector};

use crate::bodies::{Bodies, Twist};
use crate::team::Team;
use broad_phase::BroadPhase;
use manifold::{Point, manifold};
use solid::{FeatureId, Few};

/// Gap below which bodies count as touching even at rest, as a share of the body's size: above rounding, far below
/// anything that would bring in neighbours.
const REST_MARGIN: f64 = 1e-6;
/// A point that moved less than this share of its body's size between two steps is the same contact, whatever its
/// features are called now.
const SAME_POINT: f64 = 0.05;

/// Pairs of bodies of a piece of work: some ten microseconds.
const PIECE: usize = 64;

/// One contact: bodies by their index (those that never move follow the moving ones), `a` the one that never moves or
/// has the lower index.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    pub bodies: [u32; 2],
    pub features: [FeatureId; 2],
    /// World frame, halfway between the surfaces, m.
    pub point: Vector,
    /// Rows: normal from a to b, then two tangents.
    pub frame: [Vector; 3],
    /// Negative is penetration, m.
    pub gap: f64,
}

/// What detection keeps from one step to the next.
#[derive(Default)]
pub struct Memory {
    broad_phase: BroadPhase,
    /// How far each body can travel in the step, and a hair more.
    margins: Vec<f64>,
    /// What each piece of work has found.
    found: Vec<Vec<Contact>>,
}

/// Every contact that bodies may come to within `time_step`, moving at `velocities`; sorted by pair of bodies. The team
/// takes part.
pub fn detect(
    bodies: &Bodies,
    memory: &mut Memory,
    poses: &[Pose],
    velocities: &[Twist],
    time_step: f64,
    contacts: &mut Vec<Contact>,
    team: &Team,
) {
    let pose = |body: usize| match body.checked_sub(bodies.moving) {
        None => &poses[body],
        Some(fixed) => &bodies.fixed_poses[fixed],
    };
    let Memory {
        broad_phase,
        margins,
        found,
    } = memory;
    margins.clear();
    margins.extend((0..bodies.len()).map(|body| {
        let bound = bodies.bound(body);
        let speed = velocities
            .get(body)
            .map_or(0.0, |v| v.linear.length() + v.angular.length() * bound);
        time_step * speed + REST_MARGIN * bound
    }));
    let find = |[a, b]: [u32; 2], points: &mut Few<Point>, contacts: &mut Vec<Contact>| {
        let (one, other) = (a as usize, b as usize);
        let (Some(solid_a), Some(solid_b)) = (&bodies.solids[one], &bodies.solids[other]) else {
            return;
        };
        let prediction = margins[one] + margins[other];
        let Some(normal) = manifold(solid_a, pose(one), solid_b, pose(other), prediction, points)
        else {
            return;
        };
        let frame = frame(normal);
        contacts.extend(points.iter().map(|point| Contact {
            bodies: [a, b],
            features: point.features,
            point: point.position,
            frame,
            gap: point.gap,
        }));
    };
    let bounds = |body: usize| {
        let solid = bodies.solids[body].as_ref()?;
        solid.aabb(pose(body), margins[body])
    };
    let pairs = broad_phase.pairs(bodies, margins, bounds);
    let piece = if team.is_alone() {
        pairs.len().max(1)
    } else {
        PIECE
    };
    let held = found.len().max(pairs.len().div_ceil(piece));
    found.resize_with(held, Vec::new);
    let mut parts: Vec<_> = pairs.chunks(piece).zip(found).collect();
    team.each(&mut parts, |(pairs, contacts)| {
        contacts.clear();
        let points = &mut Few::new();
        pairs.iter().for_each(|&pair| find(pair, points, contacts));
    });
    contacts.clear();
    let mut parts = parts.into_iter().map(|(_, found)| found);
    // The first piece changes places with the contacts, rather than being copied.
    if let Some(first) = parts.next() {
        swap(contacts, first);
    }
    parts.for_each(|found| contacts.extend_from_slice(found));
}

/// A right-handed frame with the normal first; a vertical normal has its tangents along x and y.
pub fn frame(normal: Vector) -> [Vector; 3] {
    let seed = if normal.x.abs() < 0.9 {
        Vector::X
    } else {
        Vector::Y
    };
    let first = (seed - normal * normal.dot(seed)).normalize();
    [normal, first, normal.cross(first)]
}

/// Share by which an impulse may differ from one that was kept for a while, for both to be of the same load.
const SAME_LOAD: f64 = 0.5;

/// Where a contact starts a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Start {
    /// N s.
    pub impulse: [f64; 3],
    /// How many steps in a row, up to the last, have kept the impulse that they started from.
    pub kept: u32,
}

/// Put where `contacts` start into `start`, world frame turned into theirs: what the step before has left for the same
/// contact.
///
/// A contact is the same where its bodies are and its features have the same names; a contact whose features are not
/// found takes what is left for the nearest one left over in the pair, if that is near.
pub fn match_starts(
    bodies: &Bodies,
    contacts: &[Contact],
    previous: &[Contact],
    left: &[Start],
    start: &mut Vec<Start>,
) {
    start.clear();
    start.resize(contacts.len(), Start::default());
    let key = |contact: &Contact| (contact.bodies[1], contact.bodies[0]);
    let mut before = 0;
    let mut now = 0;
    while now < contacts.len() && before < previous.len() {
        if key(&previous[before]) < key(&contacts[now]) {
            before += 1;
            continue;
        }
        let pair = key(&contacts[now]);
        let new_end = now + run_length(&contacts[now..], |c| key(c) == pair);
        let old_end = before + run_length(&previous[before..], |c| key(c) == pair);
        let reach = SAME_POINT * bodies.size([pair.0, pair.1]);
        match_pair(
            &contacts[now..new_end],
            &previous[before..old_end],
            &left[before..old_end],
            reach,
            &mut start[now..new_end],
        );
        (now, before) = (new_end, old_end);
    }
}

fn run_length(contacts: &[Contact], same: impl Fn(&Contact) -> bool) -> usize {
    contacts.iter().take_while(|c| same(c)).count()
}

fn match_pair(
    contacts: &[Contact],
    previous: &[Contact],
    left: &[Start],
    reach: f64,
    start: &mut [Start],
) {
    // As a rule the pair touches as it did: all names are the same, in the same order.
    let as_before = contacts.len() == previous.len()
        && contacts
            .iter()
            .zip(previous)
            .all(|(contact, previous)| contact.features == previous.features);
    if as_before {
        for (k, start) in start.iter_mut().enumerate() {
            *start = left[k].turned(&previous[k].frame, &contacts[k].frame);
        }
        return;
    }
    let mut taken = vec![false; previous.len()];
    let mut found = vec![None; contacts.len()];
    for (contact, found) in contacts.iter().zip(&mut found) {
        let same = |k: &usize| !taken[*k] && previous[*k].features == contact.features;
        *found = (0..previous.len()).find(same);
        if let Some(k) = *found {
            taken[k] = true;
        }
    }
    for (contact, found) in contacts.iter().zip(&mut found) {
        if found.is_some() {
            continue;
        }
        let distance = |k: usize| previous[k].point.distance(contact.point);
        let nearest = (0..previous.len())
            .filter(|k| !taken[*k] && distance(*k) <= reach)
            .min_by(|j, k| distance(*j).total_cmp(&distance(*k)));
        if let Some(k) = nearest {
            *found = Some(k);
            taken[k] = true;
        }
    }
    for ((contact, found), start) in contacts.iter().zip(found).zip(start) {
        let Some(k) = found else { continue };
        *start = left[k].turned(&previous[k].frame, &contact.frame);
    }
}

impl Start {
    /// Where the next step starts, if this one started here and found an impulse.
    ///
    /// Impulses that are kept hold bodies at rest to the tolerance, but they are not quite the load: what they leave, the
    /// first step that does not keep them stops, which is no load either. As bodies rest before and after all these steps,
    /// the mean of their impulses is the load. Where an impulse is another altogether, the load has changed.
    pub fn after(&self, impulse: [f64; 3]) -> Self {
        let change: [f64; 3] = std::array::from_fn(|r| impulse[r] - self.impulse[r]);
        let square = |p: &[f64; 3]| p.iter().map(|p| p * p).sum::<f64>();
        if impulse == self.impulse {
            Self {
                impulse,
                kept: self.kept.saturating_add(1),
            }
        } else if self.kept > 0 && square(&change) <= SAME_LOAD * SAME_LOAD * square(&self.impulse)
        {
            let share = 1.0 / (f64::from(self.kept) + 1.0);
            Self {
                impulse: std::array::from_fn(|r| self.impulse[r] + share * change[r]),
                kept: 0,
            }
        } else {
            Self { impulse, kept: 0 }
        }
    }

    /// The normal part is kept; the tangential part follows the frame, which turns with the normal.
    fn turned(&self, before: &[Vector; 3], now: &[Vector; 3]) -> Self {
        if before == now {
            return *self;
        }
        let [n, t1, t2] = self.impulse;
        let tangential = before[1] * t1 + before[2] * t2;
        Self {
            impulse: [n, tangential.dot(now[1]), tangential.dot(now[2])],
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::{CombineRule, Material};
    use parry3d_f64::math::Matrix;
    use solid::Solid;

    fn two_balls() -> Bodies {
        let material = Material {
            friction: 0.5,
            friction_rule: CombineRule::GeometricMean,
            elasticity: [1.0; 2],
            elasticity_rule: CombineRule::CentreOfMass,
        };
        Bodies {
            moving: 2,
            solids: vec![Some(Solid::Sphere { radius: 1.0 }); 2],
            materials: vec![material; 2],
            masses: vec![1.0; 2],
            inertias: vec![Matrix::IDENTITY; 2],
            inverse_inertias: vec![Matrix::IDENTITY; 2],
            inverse_inertia_roots: vec![Matrix::IDENTITY; 2],
            fixed_poses: Vec::new(),
        }
    }

    fn contact(features: [u32; 2], x: f64, normal: Vector) -> Contact {
        Contact {
            bodies: [0, 1],
            features,
            point: Vector::X * x,
            frame: frame(normal),
            gap: 0.0,
        }
    }

    fn start(
        bodies: &Bodies,
        now: &[Contact],
        previous: &[Contact],
        impulses: &[[f64; 3]],
    ) -> Vec<[f64; 3]> {
        let left = |&impulse: &[f64; 3]| Start { impulse, kept: 0 };
        let left: Vec<Start> = impulses.iter().map(left).collect();
        let mut start = Vec::new();
        match_starts(bodies, now, previous, &left, &mut start);
        start.into_iter().map(|start| start.impulse).collect()
    }

    #[test]
    fn impulses_follow_the_names_of_features_and_then_the_nearest_point() {
        let previous = [
            contact([1, 1], 0.0, Vector::Z),
            contact([2, 2], 0.3, Vector::Z),
            contact([3, 3], 0.6, Vector::Z),
        ];
        let now = [
            contact([2, 2], 0.02, Vector::Z), // same name, although another point is nearer
            contact([9, 9], 0.61, Vector::Z), // another name, near the third
            contact([8, 8], 0.9, Vector::Z),  // near nothing
        ];
        let impulses = [[1.0, 0.1, 0.2], [2.0, 0.3, 0.4], [3.0, 0.5, 0.6]];
        let start = start(&two_balls(), &now, &previous, &impulses);
        assert_eq!(start, [[2.0, 0.3, 0.4], [3.0, 0.5, 0.6], [0.0; 3]]);
    }

    #[test]
    fn tangential_impulses_keep_their_direction_when_the_frame_turns() {
        let previous = [contact(
            [1, 1],
            0.0,
            Vector::new(0.895, 0.0, 0.446).normalize(),
        )];
        let now = [contact(
            [1, 1],
            0.0,
            Vector::new(0.905, 0.0, 0.425).normalize(),
        )];
        let start = start(&two_balls(), &now, &previous, &[[1.0, 0.5, -0.25]]);
        let world =
            |contact: &Contact, p: [f64; 3]| contact.frame[1] * p[1] + contact.frame[2] * p[2];
        let before = world(&previous[0], [1.0, 0.5, -0.25]);
        let after = world(&now[0], start[0]);
        assert!(previous[0].frame[1].distance(now[0].frame[1]) > 1.0);
        assert!((before - after).length() < 0.02);
    }

    #[test]
    fn steps_start_from_the_mean_of_kept_impulses_unless_the_load_has_changed() {
        let start = Start {
            impulse: [4.0, 1.0, 0.0],
            kept: 2,
        };
        let kept = start.after(start.impulse);
        assert_eq!((kept.impulse, kept.kept), (start.impulse, 3));
        let stopped = kept.after([3.2, 1.0, 0.4]);
        assert_eq!((stopped.impulse, stopped.kept), ([3.8, 1.0, 0.1], 0));
        let lifted = kept.after([0.5, 0.0, 0.0]);
        assert_eq!((lifted.impulse, lifted.kept), ([0.5, 0.0, 0.0], 0));
        let next = stopped.after([3.0, 1.0, 0.0]);
        assert_eq!((next.impulse, next.kept), ([3.0, 1.0, 0.0], 0));
        let landed = Start::default().after([0.0; 3]).after([2.0, 0.0, 0.0]);
        assert_eq!((landed.impulse, landed.kept), ([2.0, 0.0, 0.0], 0));
    }

    #[test]
    fn pairs_that_parted_or_met_do_not_upset_the_others() {
        let other = |bodies: [u32; 2]| Contact {
            bodies,
            ..contact([1, 1], 0.0, Vector::Z)
        };
        let mut bodies = two_balls();
        bodies.moving = 4;
        bodies.solids = vec![Some(Solid::Sphere { radius: 1.0 }); 4];
        let previous = [other([0, 1]), other([0, 2]), other([2, 3])];
        let now = [other([0, 1]), other([1, 2]), other([2, 3])];
        let impulses = [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]];
        let start = start(&bodies, &now, &previous, &impulses);
        let normals: Vec<f64> = start.iter().map(|p| p[0]).collect();
        assert_eq!(normals, [1.0, 0.0, 3.0]);
    }
}
