//! The shapes that collide, and the three questions that contact generation asks of them: the support point of a
//! direction, the face or edge that looks that way, and the nearest point of the surface.

use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::{Matrix, Pose, Vector};
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::{
    ConvexPolyhedron, Cuboid, Cylinder as AxisYCylinder, Segment, SharedShape, SupportMap,
};
use smallvec::SmallVec;

/// Corners of the polygon that stands for the flat cap of a cylinder; all of them lie on its rim.
const CAP_CORNERS: usize = 8;
/// A cylinder touches with its cap where the direction is steeper than this against its axis, else with its side.
const CAP_COSINE: f64 = 0.5;

const VERTEX: u32 = 1 << 30;
const EDGE: u32 = 2 << 30;
const FACE: u32 = 3 << 30;

/// The name of a vertex, edge or face: equal between steps while the same features touch.
pub type FeatureId = u32;

pub fn edge_id(face: usize, side: usize) -> FeatureId {
    EDGE | (face << 8 | side) as u32
}

pub fn face_id(face: usize) -> FeatureId {
    FACE | face as u32
}

/// A shape in the frame of its body, whose origin is the centre of mass.
#[derive(Clone)]
pub enum Solid {
    Sphere {
        radius: f64,
    },
    /// Everything below the plane through the body's position.
    HalfSpace {
        normal: Vector,
    },
    Convex(Convex),
}

/// A convex core, thickened by a border: a capsule is a segment with a border.
#[derive(Clone)]
pub struct Convex {
    pub core: Core,
    /// The flat faces of the core. Those of a box stand in the order -x, x, -y, y, -z, z.
    pub faces: Vec<Face>,
    pub border: f64,
    /// Radius of the smallest ball about the origin that holds the shape, m.
    pub bound: f64,
}

#[derive(Clone)]
pub enum Core {
    Polytope(Polytope),
    Segment { half_length: f64 },
    Cylinder { radius: f64, half_length: f64 },
}

/// A polyhedron with planar faces; a box is one of them.
#[derive(Clone)]
pub struct Polytope {
    pub points: Vec<Vector>,
    /// Directions of the edges, each once whatever its sign.
    pub edge_directions: Vec<Vector>,
    /// Every edge as its two vertices and the index of its direction.
    pub edges: Vec<([u32; 2], usize)>,
    /// Half lengths, where it is a box along its own axes.
    pub half: Option<Vector>,
    surface: SharedShape,
}

#[derive(Clone)]
pub struct Face {
    pub plane: Plane,
    /// Vertices in counter-clockwise order seen from outside, and their names.
    corners: Vec<Vector>,
    ids: Vec<FeatureId>,
    /// Through the side from each vertex to the next, at right angles to the face.
    pub sides: Vec<Plane>,
}

/// The plane normal·x = offset; the shape is below it.
#[derive(Clone, Copy)]
pub struct Plane {
    /// Unit, outwards.
    pub normal: Vector,
    pub offset: f64,
}

/// The corners of a face: without an allocation as long as they are no more than a cylinder's cap has.
pub type Few<T> = SmallVec<[T; CAP_CORNERS]>;

/// The polygon (three points or more) or the edge (two) of a shape that looks along a direction.
#[derive(Default)]
pub struct Feature {
    pub points: Few<Vector>,
    pub ids: Few<FeatureId>,
    /// The number of the face; of an edge, one that no face has.
    pub face: usize,
}

impl Feature {
    fn set(&mut self, points: &[Vector], ids: &[FeatureId], face: usize) {
        self.points.clear();
        self.points.extend_from_slice(points);
        self.ids.clear();
        self.ids.extend_from_slice(ids);
        self.face = face;
    }
}

impl Plane {
    fn through(point: Vector, normal: Vector) -> Self {
        Self {
            normal,
            offset: point.dot(normal),
        }
    }

    pub fn height(&self, point: Vector) -> f64 {
        point.dot(self.normal) - self.offset
    }
}

impl Face {
    fn new(normal: Vector, corners: &[Vector], ids: Vec<FeatureId>) -> Self {
        let ends = corners.iter().cycle().skip(1);
        // Seen from outside the face runs counter-clockwise, so that the inside is on the left.
        let sides = corners.iter().zip(ends).map(|(&start, &end)| {
            Plane::through(start, (end - start).cross(normal).normalize_or_zero())
        });
        Self {
            plane: Plane::through(corners[0], normal),
            sides: sides.collect(),
            corners: corners.to_vec(),
            ids,
        }
    }
}

impl Polytope {
    /// The index of the edges' direction along an axis of a box.
    pub fn edge_direction(&self, axis: usize) -> usize {
        let directions = self.edge_directions.iter();
        let along = directions.map(|direction| direction[axis].abs());
        let (index, _) =
            along.enumerate().fold(
                (0, 0.0),
                |best, (index, along)| {
                    if along > best.1 { (index, along) } else { best }
                },
            );
        index
    }
}

impl Solid {
    pub fn bound(&self) -> f64 {
        match self {
            Solid::Sphere { radius } => *radius,
            Solid::HalfSpace { .. } => 0.0,
            Solid::Convex(convex) => convex.bound,
        }
    }

    /// The box around the shape in its pose, `margin` wider on every side; None for what has no bounds.
    pub fn aabb(&self, pose: &Pose, margin: f64) -> Option<Aabb> {
        let half = match self {
            Solid::Sphere { radius } => Vector::splat(*radius),
            Solid::HalfSpace { .. } => return None,
            Solid::Convex(Convex {
                core:
                    Core::Polytope(Polytope {
                        half: Some(half), ..
                    }),
                ..
            }) => {
                let turn = Matrix::from_quat(pose.rotation);
                turn.x_axis.abs() * half.x + turn.y_axis.abs() * half.y + turn.z_axis.abs() * half.z
            }
            Solid::Convex(convex) => {
                let mut low = Vector::ZERO;
                let mut high = Vector::ZERO;
                let turn = Matrix::from_quat(pose.rotation);
                for axis in 0..3 {
                    let local = turn.row(axis);
                    high[axis] = convex.support(local).dot(local);
                    low[axis] = convex.support(-local).dot(local);
                }
                let margin = Vector::splat(margin);
                return Some(Aabb::new(
                    pose.translation + low - margin,
                    pose.translation + high + margin,
                ));
            }
        };
        Some(Aabb::from_half_extents(
            pose.translation,
            half + Vector::splat(margin),
        ))
    }
}

impl Convex {
    pub fn cuboid(half: Vector) -> Self {
        let corner = |i: usize| {
            let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            Vector::new(sign(0), sign(1), sign(2)) * half
        };
        let faces = [
            (Vector::NEG_X, [0, 4, 6, 2]),
            (Vector::X, [1, 3, 7, 5]),
            (Vector::NEG_Y, [0, 1, 5, 4]),
            (Vector::Y, [2, 6, 7, 3]),
            (Vector::NEG_Z, [0, 2, 3, 1]),
            (Vector::Z, [4, 5, 7, 6]),
        ]
        .map(|(normal, vertices)| (normal, vertices.to_vec()));
        let surface = SharedShape::new(Cuboid::new(half));
        let points = (0..8).map(corner).collect();
        Self::polytope(points, faces.to_vec(), Some(half), surface)
    }

    /// The convex hull of points; None where they span no volume.
    pub fn hull(points: &[Vector]) -> Option<Self> {
        let hull = ConvexPolyhedron::from_convex_hull(points)?;
        let faces = hull
            .faces()
            .iter()
            .map(|face| {
                let first = face.first_vertex_or_edge as usize;
                let range = first..first + face.num_vertices_or_edges as usize;
                (face.normal, hull.vertices_adj_to_face()[range].to_vec())
            })
            .collect();
        Some(Self::polytope(
            hull.points().to_vec(),
            faces,
            None,
            SharedShape::new(hull),
        ))
    }

    /// From its vertices, and the normal and the vertices of each face.
    fn polytope(
        points: Vec<Vector>,
        faces: Vec<(Vector, Vec<u32>)>,
        half: Option<Vector>,
        surface: SharedShape,
    ) -> Self {
        let mut edge_directions: Vec<Vector> = Vec::new();
        let mut edges = Vec::new();
        for (_, vertices) in &faces {
            for (side, &start) in vertices.iter().enumerate() {
                let end = vertices[(side + 1) % vertices.len()];
                if start > end {
                    continue; // the neighbouring face lists the same edge the other way round
                }
                let direction = (points[end as usize] - points[start as usize]).normalize();
                let known = edge_directions
                    .iter()
                    .position(|other| other.cross(direction).length() < 1e-9);
                edges.push(([start, end], known.unwrap_or(edge_directions.len())));
                if known.is_none() {
                    edge_directions.push(direction);
                }
            }
        }
        let faces = faces.iter().map(|(normal, vertices)| {
            let corners: Vec<Vector> = vertices.iter().map(|&v| points[v as usize]).collect();
            Face::new(
                *normal,
                &corners,
                vertices.iter().map(|v| VERTEX | v).collect(),
            )
        });
        let faces = faces.collect();
        let bound = points.iter().map(|p| p.length()).fold(0.0, f64::max);
        Convex {
            core: Core::Polytope(Polytope {
                points,
                edge_directions,
                edges,
                half,
                surface,
            }),
            faces,
            border: 0.0,
            bound,
        }
    }

    /// A capsule along z: the segment of `half_length` on either side, thickened by `radius`.
    pub fn capsule(radius: f64, half_length: f64) -> Self {
        Convex {
            core: Core::Segment { half_length },
            faces: Vec::new(),
            border: radius,
            bound: half_length + radius,
        }
    }

    /// A cylinder along z.
    pub fn cylinder(radius: f64, half_length: f64) -> Self {
        let cap = |normal| {
            let mut feature = Feature::default();
            cylinder_feature(radius, half_length, normal, &mut feature);
            Face::new(normal, &feature.points, feature.ids.to_vec())
        };
        Convex {
            core: Core::Cylinder {
                radius,
                half_length,
            },
            faces: vec![cap(Vector::Z), cap(Vector::NEG_Z)],
            border: 0.0,
            bound: radius.hypot(half_length),
        }
    }

    /// The point of the surface that lies furthest along a unit direction.
    pub fn support(&self, direction: Vector) -> Vector {
        self.core.local_support_point(direction) + direction * self.border
    }

    /// Put the face or edge of the core that looks along a unit direction into `feature`.
    pub fn feature(&self, direction: Vector, feature: &mut Feature) {
        match &self.core {
            Core::Polytope(_) => {
                let mut best = 0;
                let mut height = f64::NEG_INFINITY;
                for (index, face) in self.faces.iter().enumerate() {
                    let along = face.plane.normal.dot(direction);
                    if along > height {
                        (best, height) = (index, along);
                    }
                }
                let face = &self.faces[best];
                feature.set(&face.corners, &face.ids, best);
            }
            Core::Segment { half_length } => {
                let ends = [Vector::Z * -half_length, Vector::Z * *half_length];
                feature.set(&ends, &[VERTEX, VERTEX | 1], 0);
            }
            Core::Cylinder {
                radius,
                half_length,
            } => cylinder_feature(*radius, *half_length, direction, feature),
        }
    }

    /// The nearest point of the core's surface to a point, and whether the point lies inside the core.
    pub fn nearest(&self, point: Vector) -> (Vector, bool) {
        match &self.core {
            Core::Polytope(polytope) => {
                let projection = polytope.surface.project_local_point(point, false);
                (projection.point, projection.is_inside)
            }
            Core::Segment { half_length } => {
                let segment = Segment::new(Vector::Z * -half_length, Vector::Z * *half_length);
                (segment.project_local_point(point, false).point, false)
            }
            Core::Cylinder {
                radius,
                half_length,
            } => {
                let turned = AxisYCylinder::new(*half_length, *radius);
                let projection = turned.project_local_point(swapped(point), false);
                (swapped(projection.point), projection.is_inside)
            }
        }
    }
}

/// parry's cylinders stand along y, ours along z; which hand the frame has does not matter to distances.
fn swapped(v: Vector) -> Vector {
    Vector::new(v.x, v.z, v.y)
}

/// The side of a cylinder towards a direction as one segment, or a cap as a polygon with a corner at the direction's
/// azimuth, which is where a tilted cylinder touches.
fn cylinder_feature(radius: f64, half_length: f64, direction: Vector, feature: &mut Feature) {
    let radial = direction.truncate();
    let azimuth = if radial.length() > 1e-6 {
        radial.normalize()
    } else {
        Vector::X.truncate()
    };
    if direction.z.abs() < CAP_COSINE {
        let foot = (azimuth * radius).extend(-half_length);
        let ends = [foot, foot + Vector::Z * (2.0 * half_length)];
        return feature.set(&ends, &[VERTEX, VERTEX | 1], 2);
    }
    let up = direction.z > 0.0;
    let turn = if up { 1.0 } else { -1.0 };
    let face = if up { 0 } else { 1 };
    let corner = |corner: usize| {
        let angle = turn * std::f64::consts::TAU * corner as f64 / CAP_CORNERS as f64;
        let (sine, cosine) = angle.sin_cos();
        let x = azimuth.x * cosine - azimuth.y * sine;
        let y = azimuth.x * sine + azimuth.y * cosine;
        Vector::new(x * radius, y * radius, turn * half_length)
    };
    let corners: [Vector; CAP_CORNERS] = std::array::from_fn(corner);
    let id = |corner: usize| VERTEX | ((face + 1) << 8 | corner) as u32;
    let ids: [FeatureId; CAP_CORNERS] = std::array::from_fn(id);
    feature.set(&corners, &ids, face);
}

impl SupportMap for Core {
    fn local_support_point(&self, direction: Vector) -> Vector {
        match self {
            Core::Polytope(Polytope {
                half: Some(half), ..
            }) => {
                let towards = |axis: usize| {
                    if direction[axis] > 0.0 {
                        half[axis]
                    } else {
                        -half[axis]
                    }
                };
                Vector::new(towards(0), towards(1), towards(2))
            }
            Core::Polytope(polytope) => {
                let mut best = polytope.points[0];
                let mut height = best.dot(direction);
                for &point in &polytope.points[1..] {
                    let along = point.dot(direction);
                    if along > height {
                        (best, height) = (point, along);
                    }
                }
                best
            }
            Core::Segment { half_length } => Vector::Z * half_length.copysign(direction.z),
            Core::Cylinder {
                radius,
                half_length,
            } => {
                let radial = direction.truncate().normalize_or_zero() * *radius;
                radial.extend(half_length.copysign(direction.z))
            }
        }
    }
}
