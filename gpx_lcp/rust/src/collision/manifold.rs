//! Contact points between two shapes: all of a patch that may touch within the step, sharing one normal.

use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::shape::SupportMap;
use smallvec::smallvec;

use super::separation::{Origin, separation};
use super::solid::{Convex, Core, Feature, FeatureId, Few, Polytope, Solid, edge_id};

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

/// The contact points of two shapes and their common unit normal from a to b, world frame; None where they are further
/// apart than `prediction`. Two half-spaces never touch: neither moves.
pub fn manifold(
    a: &Solid,
    pose_a: &Pose,
    b: &Solid,
    pose_b: &Pose,
    prediction: f64,
) -> Option<(Vector, Few<Point>)> {
    match (a, b) {
        (Solid::Sphere { radius: ra }, Solid::Sphere { radius: rb }) => {
            let between = pose_b.translation - pose_a.translation;
            let normal = between.normalize_or(Vector::Z);
            let on_a = pose_a.translation + normal * *ra;
            one_point(normal, on_a, between.length() - ra - rb, [0, 0], prediction)
        }
        (Solid::HalfSpace { normal }, Solid::Sphere { radius }) => {
            let normal = pose_a.rotation * *normal;
            let gap = (pose_b.translation - pose_a.translation).dot(normal) - radius;
            one_point(
                normal,
                pose_b.translation - normal * (radius + gap),
                gap,
                [0, 0],
                prediction,
            )
        }
        (Solid::HalfSpace { normal }, Solid::Convex(convex)) => {
            half_space_convex(*normal, pose_a, convex, pose_b, prediction)
        }
        (Solid::Convex(convex), Solid::Sphere { radius }) => {
            convex_sphere(convex, pose_a, *radius, pose_b, prediction)
        }
        (Solid::Convex(ca), Solid::Convex(cb)) => convex_convex(ca, pose_a, cb, pose_b, prediction),
        (Solid::HalfSpace { .. }, Solid::HalfSpace { .. }) => None,
        (Solid::Sphere { .. } | Solid::Convex(_), _) => {
            let (normal, mut points) = manifold(b, pose_b, a, pose_a, prediction)?;
            for point in &mut points {
                point.features.swap(0, 1);
            }
            Some((-normal, points))
        }
    }
}

fn one_point(
    normal: Vector,
    on_a: Vector,
    gap: f64,
    features: [FeatureId; 2],
    prediction: f64,
) -> Option<(Vector, Few<Point>)> {
    (gap <= prediction).then(|| {
        let position = on_a + normal * (0.5 * gap);
        let point = Point {
            position,
            gap,
            features,
        };
        (normal, smallvec![point])
    })
}

fn half_space_convex(
    normal: Vector,
    pose_a: &Pose,
    convex: &Convex,
    pose_b: &Pose,
    prediction: f64,
) -> Option<(Vector, Few<Point>)> {
    let normal = pose_a.rotation * normal;
    let height = (pose_b.translation - pose_a.translation).dot(normal);
    if height - convex.bound > prediction {
        return None;
    }
    let feature = convex.feature(pose_b.rotation.inverse() * -normal);
    let corners = feature.points.iter().zip(&feature.ids);
    let points: Few<Point> = corners
        .filter_map(|(&corner, &id)| {
            let surface = pose_b.transform_point(corner) - normal * convex.border;
            let gap = (surface - pose_a.translation).dot(normal);
            (gap <= prediction).then(|| Point {
                position: surface - normal * (0.5 * gap),
                gap,
                features: [0, id],
            })
        })
        .collect();
    (!points.is_empty()).then_some((normal, points))
}

fn convex_sphere(
    convex: &Convex,
    pose_a: &Pose,
    radius: f64,
    pose_b: &Pose,
    prediction: f64,
) -> Option<(Vector, Few<Point>)> {
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
        let nearest = convex
            .face_normals()
            .max_by(|m, n| depth(m).total_cmp(&depth(n)));
        nearest.unwrap_or(centre.normalize_or(Vector::X))
    };
    let gap = signed - convex.border - radius;
    let on_a = pose_a.transform_point(surface + normal * convex.border);
    one_point(pose_a.rotation * normal, on_a, gap, [0, 0], prediction)
}

fn convex_convex(
    a: &Convex,
    pose_a: &Pose,
    b: &Convex,
    pose_b: &Pose,
    prediction: f64,
) -> Option<(Vector, Few<Point>)> {
    let b_in_a = pose_a.inv_mul(pose_b);
    let found = separation(a, b, &b_in_a, prediction)?;
    let normal = found.normal;
    let towards_a = b_in_a.rotation.inverse() * -normal;
    let feature_a = a.feature(normal);
    let mut feature_b = b.feature(towards_a);
    for point in &mut feature_b.points {
        *point = b_in_a.transform_point(*point);
    }
    let merge = MERGE * a.bound.min(b.bound);
    // `height` is along the normal, from the core of a to the core of b.
    let mut points = match found.origin {
        Origin::FaceA => clip(&feature_a, &feature_b, normal, merge),
        Origin::FaceB => {
            let mut points = clip(&feature_b, &feature_a, -normal, merge);
            for point in &mut points {
                point.features.swap(0, 1);
            }
            points
        }
        Origin::Edges(i, j) => match (&a.core, &b.core) {
            (Core::Polytope(pa), Core::Polytope(pb)) => {
                smallvec![edge_contact(pa, i, pb, j, &b_in_a, normal)]
            }
            _ => Few::new(),
        },
        Origin::Points(pa, pb) => overlap(&feature_a, &feature_b, normal).unwrap_or_else(|| {
            smallvec![Point {
                position: 0.5 * (pa + pb),
                gap: (pb - pa).dot(normal),
                features: [feature_a.face_id(), feature_b.face_id()],
            }]
        }),
    };
    for point in &mut points {
        point.gap -= a.border + b.border;
        // The midpoint of the cores is not that of the surfaces where the borders differ.
        let local = point.position + normal * (0.5 * (a.border - b.border));
        point.position = pose_a.transform_point(local);
    }
    points.retain(|point| point.gap <= prediction);
    (!points.is_empty()).then_some((pose_a.rotation * normal, points))
}

/// The part of `incident` that lies over the face `reference` (whose outward normal is `normal`), as contact points
/// with features [reference, incident]: Sutherland and Hodgman's clipping by the planes through the face's sides.
fn clip(reference: &Feature, incident: &Feature, normal: Vector, merge: f64) -> Few<Point> {
    #[derive(Clone, Copy)]
    struct Corner {
        at: Vector,
        features: [FeatureId; 2],
        /// The line from here to the next corner: a side of the incident feature, or one that clipping made.
        side: FeatureId,
    }
    let face = reference.face_id();
    let mut corners: Few<Corner> = incident
        .points
        .iter()
        .zip(&incident.ids)
        .enumerate()
        .map(|(k, (&at, &id))| Corner {
            at,
            features: [face, id],
            side: edge_id(incident.face, k),
        })
        .collect();
    let closed = corners.len() > 2;
    let sides = reference.points.len();
    let mut kept = Few::new();
    for side in 0..sides {
        let start = reference.points[side];
        let end = reference.points[(side + 1) % sides];
        // Seen from outside the face runs counter-clockwise, so that the inside is on the left.
        let outward = (end - start).cross(normal).normalize_or_zero();
        let height = |corner: &Corner| (corner.at - start).dot(outward);
        let cut = edge_id(reference.face, side);
        kept.clear();
        let count = corners.len();
        for k in 0..count {
            let corner = corners[k];
            let here = height(&corner);
            if here <= merge {
                kept.push(corner);
            }
            if k + 1 == count && !closed {
                break;
            }
            let next = corners[(k + 1) % count];
            let there = height(&next);
            if (here <= merge) != (there <= merge) {
                let at = corner.at + (next.at - corner.at) * (here / (here - there));
                let leaving = here <= merge;
                kept.push(Corner {
                    at,
                    features: [cut, corner.side],
                    side: if leaving { cut } else { corner.side },
                });
            }
        }
        std::mem::swap(&mut corners, &mut kept);
    }
    let origin = reference.points[0];
    let mut points: Few<Point> = Few::new();
    let mut surfaces: Few<Vector> = Few::new();
    for corner in corners {
        if surfaces
            .iter()
            .any(|at| at.distance_squared(corner.at) < merge * merge)
        {
            continue;
        }
        surfaces.push(corner.at);
        let gap = (corner.at - origin).dot(normal);
        points.push(Point {
            position: corner.at - normal * (0.5 * gap),
            gap,
            features: corner.features,
        });
    }
    points
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

fn outermost_edge(polytope: &Polytope, direction: usize, outward: Vector) -> (u32, Vector, Vector) {
    let mut best = (0, Vector::ZERO, Vector::ZERO);
    let mut height = f64::NEG_INFINITY;
    for (index, (vertices, of)) in polytope.edges.iter().enumerate() {
        if *of != direction {
            continue;
        }
        let [start, end] = vertices.map(|v| polytope.points[v as usize]);
        let along = (start + end).dot(outward);
        if along > height {
            (best, height) = ((index as u32, start, end), along);
        }
    }
    best
}
