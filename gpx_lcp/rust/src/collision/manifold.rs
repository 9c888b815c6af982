//! Contact points between two shapes: all of a patch that may touch within the step, sharing one normal.

use parry3d_f64::math::{Matrix, Pose, Vector};
use parry3d_f64::shape::SupportMap;
use smallvec::smallvec;

use super::separation::{Origin, separation};
use super::solid::{
    Convex, Core, Face, Feature, FeatureId, Few, Polytope, Solid, edge_id, face_id,
};

/// Points of one patch closer than this share of the shapes' size are one point.
const MERGE: f64 = 1e-6;
/// Two edges at a smaller angle than this (its sine) touch along a line rather than in a point.
const PARALLEL_SINE: f64 = 1e-2;

/// One point of contact, in world coordinates.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Halfway between the two surfaces.
    pub position: Vector,
    pub gap: f64,
    /// What touches on a and on b.
    pub features: [FeatureId; 2],
}

/// Put the contact points of two shapes into `points`, and return their common unit normal from a to b, world frame; None
/// where the shapes are further apart than `prediction`. Two half-spaces never touch: neither moves.
pub fn manifold(
    a: &Solid,
    pose_a: &Pose,
    b: &Solid,
    pose_b: &Pose,
    prediction: f64,
    points: &mut Few<Point>,
) -> Option<Vector> {
    points.clear();
    match (a, b) {
        (Solid::Sphere { radius: ra }, Solid::Sphere { radius: rb }) => {
            let between = pose_b.translation - pose_a.translation;
            let distance = between.length();
            let normal = between.normalize_or(Vector::Z);
            let on_a = pose_a.translation + normal * *ra;
            one_point(normal, on_a, distance - ra - rb, prediction, points)
        }
        (Solid::HalfSpace { normal }, Solid::Sphere { radius }) => {
            let normal = pose_a.rotation * *normal;
            let gap = (pose_b.translation - pose_a.translation).dot(normal) - radius;
            let on_a = pose_b.translation - normal * (radius + gap);
            one_point(normal, on_a, gap, prediction, points)
        }
        (Solid::HalfSpace { normal }, Solid::Convex(convex)) => {
            half_space_convex(*normal, pose_a, convex, pose_b, prediction, points)
        }
        (Solid::Convex(convex), Solid::Sphere { radius }) => {
            convex_sphere(convex, pose_a, *radius, pose_b, prediction, points)
        }
        (Solid::Convex(ca), Solid::Convex(cb)) => {
            convex_convex(ca, pose_a, cb, pose_b, prediction, points)
        }
        (Solid::HalfSpace { .. }, Solid::HalfSpace { .. }) => None,
        (Solid::Sphere { .. } | Solid::Convex(_), _) => {
            let normal = manifold(b, pose_b, a, pose_a, prediction, points)?;
            for point in points {
                point.features.swap(0, 1);
            }
            Some(-normal)
        }
    }
}

fn one_point(
    normal: Vector,
    on_a: Vector,
    gap: f64,
    prediction: f64,
    points: &mut Few<Point>,
) -> Option<Vector> {
    (gap <= prediction).then(|| {
        points.push(Point {
            position: on_a + normal * (0.5 * gap),
            gap,
            features: [0, 0],
        });
        normal
    })
}

fn half_space_convex(
    normal: Vector,
    pose_a: &Pose,
    convex: &Convex,
    pose_b: &Pose,
    prediction: f64,
    points: &mut Few<Point>,
) -> Option<Vector> {
    let normal = pose_a.rotation * normal;
    let height = (pose_b.translation - pose_a.translation).dot(normal);
    if height - convex.bound > prediction {
        return None;
    }
    let mut feature = Feature::default();
    convex.feature(pose_b.rotation.inverse() * -normal, &mut feature);
    for (&corner, &id) in feature.points.iter().zip(&feature.ids) {
        let surface = pose_b.transform_point(corner) - normal * convex.border;
        let gap = (surface - pose_a.translation).dot(normal);
        if gap <= prediction {
            points.push(Point {
                position: surface - normal * (0.5 * gap),
                gap,
                features: [0, id],
            });
        }
    }
    (!points.is_empty()).then_some(normal)
}

fn convex_sphere(
    convex: &Convex,
    pose_a: &Pose,
    radius: f64,
    pose_b: &Pose,
    prediction: f64,
    points: &mut Few<Point>,
) -> Option<Vector> {
    let centre = pose_a.inverse_transform_point(pose_b.translation);
    let (surface, inside) = convex.nearest(centre);
    let outward = if inside {
        surface - centre
    } else {
        centre - surface
    };
    let distance = outward.length();
    let signed = if inside { -distance } else { distance };
    // A centre on the surface itself has no direction of its own: the nearest face gives it.
    let normal = if distance > 1e-9 * convex.bound {
        outward / distance
    } else {
        let depth = |n: &Vector| (centre - convex.core.local_support_point(*n)).dot(*n);
        let normals = convex.faces.iter().map(|face| face.plane.normal);
        let nearest = normals.max_by(|m, n| depth(m).total_cmp(&depth(n)));
        nearest.unwrap_or(centre.normalize_or(Vector::X))
    };
    let gap = signed - convex.border - radius;
    let on_a = pose_a.transform_point(surface + normal * convex.border);
    one_point(pose_a.rotation * normal, on_a, gap, prediction, points)
}

fn convex_convex(
    a: &Convex,
    pose_a: &Pose,
    b: &Convex,
    pose_b: &Pose,
    prediction: f64,
    points: &mut Few<Point>,
) -> Option<Vector> {
    let b_in_a = pose_a.inv_mul(pose_b);
    let found = separation(a, b, &b_in_a, prediction)?;
    let merge = MERGE * a.bound.min(b.bound);
    // Points with the height from the core of a to that of b for their gap, and the normal from a to b, in the frame of a,
    // or of b where the face is b's.
    let (pose, normal) = match found.origin {
        Origin::FaceA(face) => {
            clip(a, face, b, &b_in_a, merge, points);
            (pose_a, a.faces[face].plane.normal)
        }
        Origin::FaceB(face) => {
            clip(b, face, a, &b_in_a.inverse(), merge, points);
            for point in points.iter_mut() {
                point.features.swap(0, 1);
            }
            (pose_b, -b.faces[face].plane.normal)
        }
        Origin::Edges(i, j) => {
            if let (Core::Polytope(pa), Core::Polytope(pb)) = (&a.core, &b.core) {
                points.push(edge_contact(pa, i, pb, j, &b_in_a, found.normal));
            }
            (pose_a, found.normal)
        }
        Origin::Points(pa, pb) => {
            let (mut feature_a, mut feature_b) = (Feature::default(), Feature::default());
            a.feature(found.normal, &mut feature_a);
            feature_in(b, &b_in_a, -found.normal, &mut feature_b);
            match overlap(&feature_a, &feature_b, found.normal) {
                Some(ends) => points.extend(ends),
                None => points.push(Point {
                    position: 0.5 * (pa + pb),
                    gap: (pb - pa).dot(found.normal),
                    features: [face_id(feature_a.face), face_id(feature_b.face)],
                }),
            }
            (pose_a, found.normal)
        }
    };
    let turn = Matrix::from_quat(pose.rotation);
    // The midpoint of the cores is not that of the surfaces where the borders differ.
    let middle = normal * (0.5 * (a.border - b.border));
    points.retain(|point| {
        point.gap -= a.border + b.border;
        point.position = turn * (point.position + middle) + pose.translation;
        point.gap <= prediction
    });
    (!points.is_empty()).then(|| turn * normal)
}

/// Put the face or edge of a shape in this pose that looks along a unit direction into `feature`.
fn feature_in(shape: &Convex, pose: &Pose, direction: Vector, feature: &mut Feature) {
    let turn = Matrix::from_quat(pose.rotation);
    shape.feature(turn.mul_transpose_vec3(direction), feature);
    for point in &mut feature.points {
        *point = turn * *point + pose.translation;
    }
}

/// The part of `other`, in this pose, that lies over a face of `reference`, as contact points in the frame of `reference`
/// with features [reference, other]: Sutherland and Hodgman's clipping by the planes through the face's sides.
fn clip(
    reference: &Convex,
    face: usize,
    other: &Convex,
    pose: &Pose,
    merge: f64,
    points: &mut Few<Point>,
) {
    #[derive(Clone, Copy)]
    struct Corner {
        at: Vector,
        features: [FeatureId; 2],
        /// The line from here to the next corner: a side of the incident feature, or one that clipping made.
        side: FeatureId,
        /// The ends of that line when it was made, before any of it was cut off.
        line: [Vector; 2],
    }
    let Face { plane, sides, .. } = &reference.faces[face];
    let mut incident = Feature::default();
    feature_in(other, pose, -plane.normal, &mut incident);
    let (mut corners, mut kept) = (&mut Few::new(), &mut Few::new());
    for (k, (&at, &id)) in incident.points.iter().zip(&incident.ids).enumerate() {
        corners.push(Corner {
            at,
            features: [face_id(face), id],
            side: edge_id(incident.face, k),
            line: [at, incident.points[(k + 1) % incident.points.len()]],
        });
    }
    let closed = corners.len() > 2;
    // Sides that face each other come one after the other: what mirrors one in the other is then cut alike at both.
    let half = sides.len() / 2;
    let facing = (0..half).flat_map(|side| [side, side + half]);
    for side in facing.chain(2 * half..sides.len()) {
        let plane = &sides[side];
        if corners
            .iter()
            .all(|corner| plane.height(corner.at) <= merge)
        {
            continue;
        }
        let cut = edge_id(face, side);
        kept.clear();
        let count = corners.len();
        for k in 0..count {
            let corner = corners[k];
            let here = plane.height(corner.at);
            if here <= merge {
                kept.push(corner);
            }
            if k + 1 == count && !closed {
                break;
            }
            let next = corners[(k + 1) % count];
            let there = plane.height(next.at);
            if (here <= merge) != (there <= merge) {
                let leaving = here <= merge;
                // Of the whole side, from the end that stays: the two sides of a patch that is its own mirror image are
                // walked in opposite ways, and cut from opposite ends, one of them first. They are to end at points that
                // mirror each other to the last bit.
                let [from, to] = corner.line;
                let (stays, goes) = if leaving { (from, to) } else { (to, from) };
                let (low, high) = (plane.height(stays), plane.height(goes));
                let at = stays + (goes - stays) * (low / (low - high));
                kept.push(Corner {
                    at,
                    features: [cut, corner.side],
                    side: if leaving { cut } else { corner.side },
                    line: [from, to],
                });
            }
        }
        for k in 0..kept.len() {
            if kept[k].side == cut {
                kept[k].line = [kept[k].at, kept[(k + 1) % kept.len()].at];
            }
        }
        std::mem::swap(&mut corners, &mut kept);
    }
    kept.clear();
    for &corner in &*corners {
        let known = |other: &Corner| other.at.distance_squared(corner.at) < merge * merge;
        if kept.iter().any(known) {
            continue;
        }
        kept.push(corner);
        let gap = plane.height(corner.at);
        points.push(Point {
            position: corner.at - plane.normal * (0.5 * gap),
            gap,
            features: corner.features,
        });
    }
}

/// The two ends of the stretch along which two nearly parallel edges run side by side; None for anything else.
fn overlap(a: &Feature, b: &Feature, normal: Vector) -> Option<Few<Point>> {
    let ([a0, a1], [b0, b1]) = (a.points.as_slice(), b.points.as_slice()) else {
        return None;
    };
    let along = (*a1 - *a0).try_normalize()?;
    let other = (*b1 - *b0).try_normalize()?;
    if along.cross(other).length() > PARALLEL_SINE {
        return None;
    }
    let length = (*a1 - *a0).dot(along);
    let (s0, s1) = ((*b0 - *a0).dot(along), (*b1 - *a0).dot(along));
    let (low, high) = (s0.min(s1).max(0.0), s0.max(s1).min(length));
    if high <= low {
        return None;
    }
    let ends = [low, high].map(|s| {
        let on_a = *a0 + along * s;
        let on_b = *b0 + (*b1 - *b0) * ((s - s0) / (s1 - s0));
        (on_a, on_b)
    });
    let point = |end: usize| Point {
        position: 0.5 * (ends[end].0 + ends[end].1),
        gap: (ends[end].1 - ends[end].0).dot(normal),
        features: [a.ids[end], b.ids[if s1 > s0 { end } else { 1 - end }]],
    };
    Some(smallvec![point(0), point(1)])
}

/// The one point where an edge of each polyhedron pass each other, the cores' outermost edges in those directions.
fn edge_contact(
    a: &Polytope,
    direction_a: usize,
    b: &Polytope,
    direction_b: usize,
    b_in_a: &Pose,
    normal: Vector,
) -> Point {
    let (index_a, a0, a1) = outermost_edge(a, direction_a, normal);
    let (index_b, b0, b1) = outermost_edge(b, direction_b, b_in_a.rotation.inverse() * -normal);
    let (b0, b1) = (b_in_a.transform_point(b0), b_in_a.transform_point(b1));
    let (da, db, r) = (a1 - a0, b1 - b0, b0 - a0);
    // The lines' nearest points; they are not parallel, or they would be no candidate.
    let (aa, ab, bb) = (da.dot(da), da.dot(db), db.dot(db));
    let determinant = aa * bb - ab * ab;
    let s = ((r.dot(da) * bb - r.dot(db) * ab) / determinant).clamp(0.0, 1.0);
    let t = ((r.dot(da) * ab - r.dot(db) * aa) / determinant).clamp(0.0, 1.0);
    let (on_a, on_b) = (a0 + da * s, b0 + db * t);
    Point {
        position: 0.5 * (on_a + on_b),
        gap: (on_b - on_a).dot(normal),
        features: [edge_id(index_a, 255), edge_id(index_b, 255)],
    }
}

fn outermost_edge(
    polytope: &Polytope,
    direction: usize,
    outward: Vector,
) -> (usize, Vector, Vector) {
    let mut best = (0, Vector::ZERO, Vector::ZERO);
    let mut height = f64::NEG_INFINITY;
    for (index, (vertices, of)) in polytope.edges.iter().enumerate() {
        if *of != direction {
            continue;
        }
        let [start, end] = vertices.map(|v| polytope.points[v as usize]);
        let along = (start + end).dot(outward);
        if along > height {
            (best, height) = ((index, start, end), along);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::samples::Uniform;
    use parry3d_f64::math::Rotation;

    #[test]
    fn what_is_named_the_other_way_round_touches_in_the_same_points() {
        let mut random = Uniform(11);
        let (mut patches, mut points, mut mirrored) = (0, Few::new(), Few::new());
        for _ in 0..3000 {
            let mut any = || Vector::from_array(random.vector());
            let [a, b] =
                [any(), any()].map(|v| Solid::Convex(Convex::cuboid(v * 0.5 + Vector::splat(0.7))));
            let [pose_a, pose_b] = [0.0, 1.0].map(|far| {
                let turn = Rotation::from_scaled_axis(any() * 0.1);
                Pose::from_parts(Vector::Z * (1.2 * far) + any() * 0.2, turn)
            });
            let normal = manifold(&a, &pose_a, &b, &pose_b, 0.1, &mut points);
            let other = manifold(&b, &pose_b, &a, &pose_a, 0.1, &mut mirrored);
            let (Some(normal), Some(other)) = (normal, other) else {
                assert_eq!(normal, other);
                continue;
            };
            assert!((normal + other).length() < 1e-12);
            assert_eq!(points.len(), mirrored.len());
            patches += usize::from(points.len() > 2);
            for point in &points {
                let [on_a, on_b] = point.features;
                let same = |other: &&Point| other.features == [on_b, on_a];
                let other = mirrored.iter().find(same).unwrap();
                assert!(point.position.distance(other.position) < 1e-12);
                assert!((point.gap - other.gap).abs() < 1e-12);
            }
        }
        assert!(patches > 100, "{patches} patches");
    }

    #[test]
    fn patches_that_mirror_themselves_have_points_that_do_to_the_last_bit() {
        let mut random = Uniform(12);
        let (mut clipped, mut points) = (0, Few::new());
        for _ in 0..3000 {
            let mut half = || Vector::from_array(random.vector()) * 0.5 + Vector::splat(0.7);
            let [a, b] = [half(), half()].map(|half| Solid::Convex(Convex::cuboid(half)));
            // Turned about y and moved across it, both are their own mirror images in the plane y = 0.
            let [pose_a, pose_b] = [0.0, 1.0].map(|far| {
                let at = Vector::new(random.draw(), 0.0, 0.1 * random.draw() + 1.2 * far);
                Pose::from_parts(at, Rotation::from_rotation_y(0.1 * random.draw()))
            });
            let normal = manifold(&a, &pose_a, &b, &pose_b, 0.2, &mut points);
            // None, or one of the two sides that mirror each other.
            if normal.is_none_or(|normal| normal.y != 0.0) {
                continue;
            }
            clipped += usize::from(points.len() == 4);
            for point in &points {
                let [x, y, z] = point.position.to_array();
                let image = Vector::new(x, -y, z);
                let same = |other: &Point| other.position == image && other.gap == point.gap;
                assert!(points.iter().any(same), "{points:?}");
            }
        }
        assert!(clipped > 300, "{clipped} patches of four points");
    }
}
