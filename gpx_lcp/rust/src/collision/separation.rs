//! The direction along which two convex shapes are furthest apart.
//!
//! For a unit direction n from a to b the separation is s(n) = min over b of n·x - max over a of n·x. Its largest value
//! is the signed distance of the shapes, and for polyhedra that touch or overlap it is reached at a face normal of
//! either or at the cross product of two edges (separating axis theorem). GJK alone would not do: bodies at rest have
//! a gap of 1e-16 m, and the direction between two points that close is noise.

use parry3d_f64::math::{Matrix, Pose, Vector};
use parry3d_f64::query::details::contact_support_map_support_map_with_params;
use parry3d_f64::query::gjk::{GJKResult, VoronoiSimplex};
use parry3d_f64::shape::SupportMap;

use super::solid::{Convex, Core, Polytope};
use crate::small_matrix::dot;

/// A later candidate must be better than an earlier one by this share of the shapes' size: faces come before edges, and
/// those of body a before those of body b, so that rounding does not make contacts flip between steps.
const PREFERENCE: f64 = 1e-6;
/// Above this many pairs of edges, the pair is taken from GJK rather than by trying all of them.
const EDGE_PAIR_LIMIT: usize = 4096;

/// Where the separating direction comes from.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Origin {
    /// The face of this number, of a or of b.
    FaceA(usize),
    FaceB(usize),
    /// Edges in these directions of a and of b.
    Edges(usize, usize),
    /// The nearest points of the cores, both in the frame of a.
    Points(Vector, Vector),
}

pub struct Separation {
    /// From a to b, unit, in the frame of a.
    pub normal: Vector,
    pub gap: f64,
    pub origin: Origin,
}

/// The best separating direction; None where the shapes are further apart than `prediction`.
pub fn separation(a: &Convex, b: &Convex, b_in_a: &Pose, prediction: f64) -> Option<Separation> {
    let tolerance = PREFERENCE * a.bound.min(b.bound);
    let turn = Matrix::from_quat(b_in_a.rotation);
    if let (Core::Polytope(pa), Core::Polytope(pb)) = (&a.core, &b.core)
        && let (Some(half_a), Some(half_b)) = (pa.half, pb.half)
    {
        let offset = b_in_a.translation;
        let found = boxes(half_a, half_b, &turn, offset, prediction, tolerance)?;
        return Some(Separation {
            origin: match found.origin {
                Origin::Edges(i, j) => Origin::Edges(pa.edge_direction(i), pb.edge_direction(j)),
                other => other,
            },
            ..found
        });
    }
    let mut best = Separation {
        normal: Vector::Z,
        gap: f64::NEG_INFINITY,
        origin: Origin::FaceA(0),
    };
    let mut consider = |normal: Vector, origin: Origin, preference: f64| {
        let gap = gap_along(a, b, &turn, b_in_a.translation, normal);
        if gap > best.gap + preference {
            best = Separation {
                normal,
                gap,
                origin,
            };
        }
        gap <= prediction
    };
    for (number, face) in a.faces.iter().enumerate() {
        if !consider(face.plane.normal, Origin::FaceA(number), 0.0) {
            return None;
        }
    }
    for (number, face) in b.faces.iter().enumerate() {
        let normal = -(turn * face.plane.normal);
        if !consider(normal, Origin::FaceB(number), tolerance) {
            return None;
        }
    }
    if let (Core::Polytope(pa), Core::Polytope(pb)) = (&a.core, &b.core)
        && pa.edge_directions.len() * pb.edge_directions.len() <= EDGE_PAIR_LIMIT
    {
        for (normal, origin) in edge_candidates(pa, pb, &turn, b_in_a.translation) {
            if !consider(normal, origin, tolerance) {
                return None;
            }
        }
    } else {
        // A round side gives its direction through the axis inside it, which stays well away from the other shape.
        let spines = (spine(&a.core), spine(&b.core));
        if spines.0.is_some() || spines.1.is_some() {
            let (core_a, core_b) = (
                spines.0.as_ref().unwrap_or(&a.core),
                spines.1.as_ref().unwrap_or(&b.core),
            );
            if let Some((normal, pa, pb)) = nearest_points(core_a, core_b, b_in_a, f64::MAX) {
                let pa = pa + normal * round_radius(&a.core);
                let pb = pb - normal * round_radius(&b.core);
                if !consider(normal, Origin::Points(pa, pb), tolerance) {
                    return None;
                }
            }
        }
        let reach = prediction + a.border + b.border;
        if let Some((normal, pa, pb)) = nearest_points(&a.core, &b.core, b_in_a, reach)
            && !consider(normal, Origin::Points(pa, pb), tolerance)
        {
            return None;
        }
    }
    best.gap.is_finite().then_some(best)
}

/// The same for two boxes of these half lengths: along a direction each reaches as far as its half lengths, projected.
///
/// Source: S. Gottschalk, M. Lin, D. Manocha, *OBBTree*, SIGGRAPH (1996). The origin `Edges` counts axes.
fn boxes(
    half_a: Vector,
    half_b: Vector,
    turn: &Matrix,
    offset: Vector,
    prediction: f64,
    tolerance: f64,
) -> Option<Separation> {
    let (half_a, half_b, offset) = (half_a.to_array(), half_b.to_array(), offset.to_array());
    // The axes of b, and how far each reaches along those of a.
    let axes = turn.to_cols_array_2d();
    let shares = axes.map(|axis| axis.map(f64::abs));
    let mut best = Separation {
        normal: Vector::Z,
        gap: f64::NEG_INFINITY,
        origin: Origin::FaceA(0),
    };
    let outward = |normal: Vector, along: f64| if along < 0.0 { -normal } else { normal };
    for k in 0..3 {
        let reach_b = (0..3).map(|j| shares[j][k] * half_b[j]).sum::<f64>();
        let gap = offset[k].abs() - half_a[k] - reach_b;
        if gap > prediction {
            return None;
        }
        if gap > best.gap {
            best = Separation {
                normal: outward(Vector::AXES[k], offset[k]),
                gap,
                origin: Origin::FaceA(2 * k + usize::from(offset[k] >= 0.0)),
            };
        }
    }
    for k in 0..3 {
        let along = dot(&axes[k], &offset);
        let gap = along.abs() - half_b[k] - dot(&shares[k], &half_a);
        if gap > prediction {
            return None;
        }
        if gap > best.gap + tolerance {
            best = Separation {
                normal: outward(Vector::from_array(axes[k]), along),
                gap,
                origin: Origin::FaceB(2 * k + usize::from(along < 0.0)),
            };
        }
    }
    for i in 0..3 {
        let (k, l) = ((i + 1) % 3, (i + 2) % 3);
        for j in 0..3 {
            let (m, n) = ((j + 1) % 3, (j + 2) % 3);
            // Axis i of a times axis j of b has -axes[j][l] in place k and axes[j][k] in place l.
            let (axis, share) = (&axes[j], &shares[j]);
            let square = axis[k] * axis[k] + axis[l] * axis[l];
            // Nearly parallel edges touch where a face does, and their cross product is all rounding.
            if square < 1e-12 {
                continue;
            }
            let along = offset[l] * axis[k] - offset[k] * axis[l];
            let reach_a = half_a[k] * share[l] + half_a[l] * share[k];
            let reach_b = half_b[m] * shares[n][i] + half_b[n] * shares[m][i];
            // All of this is too long by the root of the square, which is taken only where the gap may count.
            let gap = along.abs() - reach_a - reach_b;
            let least = (best.gap + tolerance).min(prediction);
            if gap * gap.abs() <= least * least.abs() * square {
                continue;
            }
            let length = square.sqrt();
            let gap = gap / length;
            if gap > prediction {
                return None;
            }
            if gap > best.gap + tolerance {
                let mut normal = [0.0; 3];
                (normal[k], normal[l]) = (-axis[l] / length, axis[k] / length);
                best = Separation {
                    normal: outward(Vector::from_array(normal), along),
                    gap,
                    origin: Origin::Edges(i, j),
                };
            }
        }
    }
    best.gap.is_finite().then_some(best)
}

/// The gap along a unit direction, with b in the frame of a turned by `turn` and moved by `offset`.
fn gap_along(a: &Convex, b: &Convex, turn: &Matrix, offset: Vector, normal: Vector) -> f64 {
    let towards_a = -(turn.transpose() * normal);
    let on_b = *turn * b.core.local_support_point(towards_a) + offset;
    let on_a = a.core.local_support_point(normal);
    (on_b - on_a).dot(normal) - a.border - b.border
}

fn edge_candidates<'s>(
    a: &'s Polytope,
    b: &'s Polytope,
    turn: &'s Matrix,
    offset: Vector,
) -> impl Iterator<Item = (Vector, Origin)> + 's {
    let pairs = (0..a.edge_directions.len())
        .flat_map(move |i| (0..b.edge_directions.len()).map(move |j| (i, j)));
    pairs.filter_map(move |(i, j)| {
        let axis = a.edge_directions[i].cross(*turn * b.edge_directions[j]);
        // Nearly parallel edges touch where a face does, and their cross product is all rounding.
        if axis.length() < 1e-6 {
            return None;
        }
        let axis = axis.normalize();
        let outward = if axis.dot(offset) < 0.0 { -axis } else { axis };
        Some((outward, Origin::Edges(i, j)))
    })
}

fn spine(core: &Core) -> Option<Core> {
    match core {
        Core::Cylinder { half_length, .. } => Some(Core::Segment {
            half_length: *half_length,
        }),
        _ => None,
    }
}

fn round_radius(core: &Core) -> f64 {
    match core {
        Core::Cylinder { radius, .. } => *radius,
        _ => 0.0,
    }
}

/// Direction from a to b and the nearest (or deepest) points of two cores, in the frame of a.
fn nearest_points(
    a: &Core,
    b: &Core,
    b_in_a: &Pose,
    reach: f64,
) -> Option<(Vector, Vector, Vector)> {
    let mut simplex = VoronoiSimplex::new();
    match contact_support_map_support_map_with_params(b_in_a, a, b, reach, &mut simplex, None) {
        GJKResult::ClosestPoints(pa, pb, normal) if normal.is_finite() => Some((normal, pa, pb)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::samples::Uniform;
    use parry3d_f64::math::Rotation;

    fn cube() -> Convex {
        Convex::cuboid(Vector::splat(0.5))
    }

    fn above(height: f64, rotation: Rotation) -> Pose {
        Pose::from_parts(Vector::Z * height, rotation)
    }

    #[test]
    fn faces_that_touch_give_their_normal_exactly() {
        for gap in [0.0, 1e-16, -1e-16, -0.1] {
            let pose = above(1.0 + gap, Rotation::IDENTITY);
            let found = separation(&cube(), &cube(), &pose, 1.0).unwrap();
            assert_eq!(found.normal, Vector::Z);
            assert_eq!(found.origin, Origin::FaceA(5));
            assert!((found.gap - gap).abs() < 1e-15);
        }
    }

    #[test]
    fn a_cube_on_its_corner_over_a_face_takes_the_face() {
        let tilt = Rotation::from_rotation_x(0.7) * Rotation::from_rotation_y(0.6);
        let found = separation(&cube(), &cube(), &above(1.5, tilt), 1.0).unwrap();
        assert_eq!(found.origin, Origin::FaceA(5));
        // The same two cubes, named the other way round: now the face belongs to b.
        let swapped = above(1.5, tilt).inverse();
        let found = separation(&cube(), &cube(), &swapped, 1.0).unwrap();
        assert_eq!(found.origin, Origin::FaceB(5));
        assert!((tilt * found.normal - Vector::NEG_Z).length() < 1e-12);
    }

    #[test]
    fn crossed_edges_are_found_at_a_gap_of_nothing() {
        let quarter = std::f64::consts::FRAC_PI_4;
        let lower = Rotation::from_rotation_x(quarter);
        let pose = Pose::from_rotation(lower.inverse())
            * above(2.0_f64.sqrt(), Rotation::from_rotation_y(quarter));
        let found = separation(&cube(), &cube(), &pose, 1.0).unwrap();
        assert!(matches!(found.origin, Origin::Edges(..)));
        assert!(found.gap.abs() < 1e-15);
        assert!((lower * found.normal - Vector::Z).length() < 1e-12);
    }

    #[test]
    fn bodies_beyond_the_prediction_are_left_out() {
        let pose = above(1.2, Rotation::IDENTITY);
        assert!(separation(&cube(), &cube(), &pose, 0.1).is_none());
        assert!(separation(&cube(), &cube(), &pose, 0.3).is_some());
    }

    #[test]
    fn a_cylinder_on_its_side_has_a_normal_through_its_axis() {
        let cylinder = Convex::cylinder(0.5, 1.0);
        let lying = Rotation::from_rotation_x(std::f64::consts::FRAC_PI_2);
        for gap in [0.0, 1e-15, -1e-3] {
            let pose = Pose::from_rotation(lying.inverse()) * above(1.0 + gap, lying);
            let found = separation(&cylinder, &cylinder, &pose, 1.0).unwrap();
            assert!((lying * found.normal - Vector::Z).length() < 1e-12);
            assert!((found.gap - gap).abs() < 1e-12);
        }
    }

    #[test]
    fn boxes_are_as_far_apart_as_polyhedra_with_their_corners() {
        let mut random = Uniform(10);
        let (mut faces, mut edges) = (0, 0);
        for _ in 0..3000 {
            let mut any = || Vector::from_array(random.vector());
            let [a, b] = [any(), any()].map(|v| Convex::cuboid(v * 0.5 + Vector::splat(0.7)));
            let (offset, turn) = (any() * 2.0, Rotation::from_scaled_axis(any() * 3.0));
            let pose = Pose::from_parts(offset, turn);
            let found = separation(&a, &b, &pose, 0.1);
            let [general_a, general_b] = [&a, &b].map(|convex| {
                let mut convex = convex.clone();
                if let Core::Polytope(polytope) = &mut convex.core {
                    polytope.half = None;
                }
                convex
            });
            let general = separation(&general_a, &general_b, &pose, 0.1);
            let (Some(found), Some(general)) = (&found, &general) else {
                assert_eq!(found.is_some(), general.is_some());
                continue;
            };
            assert!((found.gap - general.gap).abs() < 1e-5);
            if found.origin == general.origin {
                assert!(found.normal.distance(general.normal) < 1e-12);
            }
            match found.origin {
                Origin::Edges(..) => edges += 1,
                _ => faces += 1,
            }
        }
        assert!(faces > 300 && edges > 100, "{faces} faces, {edges} edges");
    }
}
