//! Friction bounded by a convex polygon instead of a disc: p_t ∈ μ p_n P, with the most dissipation that P allows.
//!
//! The corners of P at angles 2πj/k make the linearised cone of Stewart and Trinkle; the square with corners (±1, ±1) makes
//! the boxed LCP, in which each tangent direction has its own bound μ p_n.

use crate::contact::{Contact, Law};
use crate::lanes::{Lanes, Memory};
use crate::small_matrix::{Vector, dot};

/// The law 0 ≤ p_n ⟂ u_n ≥ 0, -u_t in the normal cone of μ p_n P at p_t.
///
/// Tangent vectors are stored as contact vectors whose normal entry is zero.
pub struct Polygon<const R: usize> {
    corners: Vec<Vector<R>>,
    /// Unit vector from each corner to the next.
    along: Vec<Vector<R>>,
    /// Unit outward normal of the edge from each corner to the next, and its distance from the centre.
    outward: Vec<(Vector<R>, f64)>,
    lengths: Vec<f64>,
    /// Square of the radius of the largest disc around the centre.
    inner: f64,
}

/// Where on the polygon a contact slides.
#[derive(Clone, Copy, Debug)]
pub enum Feature {
    Corner(usize),
    /// The edge from this corner to the next.
    Edge(usize),
}

impl<const R: usize> Polygon<R> {
    /// Make the polygon from its corners, anticlockwise; in the plane (R = 2) these are the two ends of an interval.
    pub fn new(corners: Vec<Vector<R>>) -> Self {
        let count = corners.len();
        let (mut along, mut outward, mut lengths) = (Vec::new(), Vec::new(), Vec::new());
        for (j, corner) in corners.iter().enumerate() {
            let next = &corners[(j + 1) % count];
            let edge: Vector<R> = std::array::from_fn(|r| next[r] - corner[r]);
            let length = dot(&edge, &edge).sqrt();
            let unit = edge.map(|value| value / length);
            let mut normal = [0.0; R];
            if R == 3 {
                (normal[1], normal[2]) = (unit[2], -unit[1]);
            } else {
                normal = *corner;
            }
            outward.push((normal, dot(&normal, corner)));
            along.push(unit);
            lengths.push(length);
        }
        let inner = outward.iter().map(|(_, support)| support * support);
        Self {
            inner: inner.fold(f64::INFINITY, f64::min),
            corners,
            along,
            outward,
            lengths,
        }
    }

    fn holds(&self, radius: f64, tangent: &Vector<R>) -> bool {
        let square: f64 = tangent[1..].iter().map(|value| value * value).sum();
        square <= radius * radius * self.inner
            || self
                .outward
                .iter()
                .all(|(normal, support)| dot(normal, tangent) <= radius * support)
    }

    /// The point of radius · P nearest to a tangent vector (whose normal entry is ignored).
    fn nearest(&self, radius: f64, vector: &Vector<R>) -> Vector<R> {
        let mut tangent = *vector;
        tangent[0] = 0.0;
        if R == 2 {
            tangent[1] = tangent[1].clamp(-radius, radius);
            return tangent;
        }
        if radius <= 0.0 {
            return [0.0; R];
        }
        if self.holds(radius, &tangent) {
            return tangent;
        }
        let mut best = ([0.0; R], f64::INFINITY);
        for ((corner, along), length) in self.corners.iter().zip(&self.along).zip(&self.lengths) {
            let offset: Vector<R> = std::array::from_fn(|r| tangent[r] - radius * corner[r]);
            let position = dot(&offset, along).clamp(0.0, radius * length);
            let point: Vector<R> =
                std::array::from_fn(|r| radius * corner[r] + position * along[r]);
            let distance = (0..R).map(|r| (tangent[r] - point[r]).powi(2)).sum();
            if distance < best.1 {
                best = (point, distance);
            }
        }
        best.0
    }

    #[inline(always)]
    fn at(
        &self,
        feature: Feature,
        contact: &Contact<f64, R>,
        b: &Vector<R>,
    ) -> Option<(Vector<R>, f64)> {
        match feature {
            Feature::Corner(j) => self.at_corner(contact, b, j),
            Feature::Edge(j) if R == 3 => self.on_edge(contact, b, j),
            Feature::Edge(_) => None,
        }
    }

    /// Sliding at corner j: the impulse, and by how much the velocity (m/s) fails to prefer this corner.
    fn at_corner(
        &self,
        contact: &Contact<f64, R>,
        b: &Vector<R>,
        j: usize,
    ) -> Option<(Vector<R>, f64)> {
        let count = self.corners.len();
        let mut ray = self.corners[j].map(|value| contact.friction * value);
        ray[0] = 1.0;
        let resistance = dot(&contact.block()[0], &ray);
        if resistance <= 0.0 {
            return None;
        }
        let p_n = -b[0] / resistance;
        let impulse = ray.map(|value| p_n * value);
        let u = velocity(contact, b, &impulse);
        let previous = (j + count - 1) % count;
        Some((
            impulse,
            (-dot(&u, &self.along[j])).max(dot(&u, &self.along[previous])),
        ))
    }

    /// Sliding on the edge that starts at corner j: u_n = 0, and no velocity along the edge.
    fn on_edge(
        &self,
        contact: &Contact<f64, R>,
        b: &Vector<R>,
        j: usize,
    ) -> Option<(Vector<R>, f64)> {
        let along = &self.along[j];
        let mut ray = self.corners[j].map(|value| contact.friction * value);
        ray[0] = 1.0;
        let (from_ray, from_edge) = (
            velocity(contact, &[0.0; R], &ray),
            velocity(contact, &[0.0; R], along),
        );
        // [ n·A ray, n·A e; e·A ray, e·A e ] (p_n, q) = -(b_n, e·b)
        let matrix = [
            [from_ray[0], from_edge[0]],
            [dot(along, &from_ray), dot(along, &from_edge)],
        ];
        let rhs = [-b[0], -dot(along, b)];
        let determinant = matrix[0][0] * matrix[1][1] - matrix[0][1] * matrix[1][0];
        let p_n = (rhs[0] * matrix[1][1] - matrix[0][1] * rhs[1]) / determinant;
        let q = (matrix[0][0] * rhs[1] - rhs[0] * matrix[1][0]) / determinant;
        if !(p_n > 0.0 && (0.0..=contact.friction * p_n * self.lengths[j]).contains(&q)) {
            return None;
        }
        let impulse: Vector<R> = std::array::from_fn(|r| p_n * ray[r] + q * along[r]);
        let u = velocity(contact, b, &impulse);
        Some((impulse, dot(&u, &self.outward[j].0)))
    }
}

fn velocity<const R: usize>(
    contact: &Contact<f64, R>,
    b: &Vector<R>,
    impulse: &Vector<R>,
) -> Vector<R> {
    let block = contact.block();
    std::array::from_fn(|r| b[r] + dot(&block[r], impulse))
}

impl<const R: usize> Law<R> for Polygon<R> {
    /// Where it slid last.
    type Local = Option<Feature>;

    #[inline(always)]
    fn contains<V: Lanes>(&self, friction: V, impulse: &[V; R]) -> V::Mask {
        let radius = friction * impulse[0];
        let mut square = V::splat(0.0);
        for r in 1..R {
            square = square.plus_product(impulse[r], impulse[r]);
        }
        let pushes = impulse[0].at_least(V::splat(0.0));
        let inner = (radius * radius * V::splat(self.inner)).at_least(square);
        if V::bits(inner) & V::bits(pushes) == V::bits(pushes) {
            return V::both(pushes, inner);
        }
        let mut holds = pushes;
        for (normal, support) in &self.outward {
            let mut reach = V::splat(0.0);
            for r in 1..R {
                reach = reach.plus_product(V::splat(normal[r]), impulse[r]);
            }
            holds = V::both(holds, (radius * V::splat(*support)).at_least(reach));
        }
        holds
    }

    #[inline(always)]
    fn separates<V: Lanes>(&self, _friction: V, b: &[V; R]) -> V::Mask {
        b[0].at_least(V::splat(0.0))
    }

    /// Try every corner and every edge; the first that satisfies the law is it.
    ///
    /// Where rounding leaves none, or strong coupling leaves truly none, the one that fails by least is taken.
    fn slide(
        &self,
        contact: &Contact<f64, R>,
        local: &mut Option<Feature>,
        b: &Vector<R>,
    ) -> Option<Vector<R>> {
        let mut best: Option<(Vector<R>, f64)> = None;
        for j in 0..self.corners.len() {
            for feature in [Feature::Corner(j), Feature::Edge(j)] {
                let Some((impulse, excess)) = self.at(feature, contact, b) else {
                    continue;
                };
                if best.is_none_or(|(_, least)| excess < least) {
                    best = Some((impulse, excess));
                    *local = Some(feature);
                }
                if excess <= 0.0 {
                    return Some(impulse);
                }
            }
        }
        best.map(|(impulse, _)| impulse)
    }

    /// Try what each contact was last; written out in numbers, because lanes differ in their corners.
    #[inline(always)]
    fn slide_on<V: Lanes>(
        &self,
        contact: &mut Contact<V::Memory, R>,
        locals: &[Option<Feature>],
        b: &[V; R],
        _wanted: u32,
    ) -> ([V; R], V::Mask) {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        if R != 3 {
            return (*b, V::splat(-1.0).at_least(zero));
        }
        // The corner, the edges after it and before it, the length of the former; at the corner, on the edge: 1 or 0.
        let mut table = [V::Memory::filled(0.0); 9];
        for (lane, local) in locals.iter().enumerate() {
            let (j, place) = match *local {
                Some(Feature::Corner(j)) => (j, 7),
                Some(Feature::Edge(j)) => (j, 8),
                None => continue,
            };
            let previous = if j == 0 { self.corners.len() } else { j } - 1;
            for k in 0..2 {
                table[k].set(lane, self.corners[j][1 + k]);
                table[2 + k].set(lane, self.along[j][1 + k]);
                table[4 + k].set(lane, self.along[previous][1 + k]);
            }
            table[6].set(lane, self.lengths[j]);
            table[place].set(lane, 1.0);
        }
        let mut t = [zero; 9];
        for k in 0..9 {
            t[k] = V::load(&table[k]);
        }
        let [
            x,
            y,
            e_x,
            e_y,
            before_x,
            before_y,
            length,
            at_corner,
            on_edge,
        ] = t;
        let friction = V::load(&contact.friction);
        let ray = [one, friction * x, friction * y];
        let (mut from_ray, mut from_edge) = ([zero; 3], [zero; 3]);
        for r in 0..3 {
            let row = [
                V::load(contact.block_at(r, 0)),
                V::load(contact.block_at(r, 1)),
                V::load(contact.block_at(r, 2)),
            ];
            from_ray[r] = row[0] + row[1] * ray[1] + row[2] * ray[2];
            from_edge[r] = row[1] * e_x + row[2] * e_y;
        }
        // As in `on_edge`, and as in `at_corner` where q = 0.
        let matrix = [
            [from_ray[0], from_edge[0]],
            [
                e_x * from_ray[1] + e_y * from_ray[2],
                e_x * from_edge[1] + e_y * from_edge[2],
            ],
        ];
        let rhs = [-b[0], -(e_x * b[1] + e_y * b[2])];
        let corner = at_corner.at_least(one);
        let determinant = (matrix[0][0] * matrix[1][1] - matrix[0][1] * matrix[1][0])
            .replaced(corner, matrix[0][0]);
        let p_n =
            (rhs[0] * matrix[1][1] - matrix[0][1] * rhs[1]).replaced(corner, rhs[0]) / determinant;
        let q =
            ((matrix[0][0] * rhs[1] - rhs[0] * matrix[1][0]) / determinant).replaced(corner, zero);
        let mut impulse = *b;
        impulse[0] = p_n;
        impulse[1] = p_n * ray[1] + q * e_x;
        impulse[2] = p_n * ray[2] + q * e_y;
        let u_x = b[1] + from_ray[1] * p_n + from_edge[1] * q;
        let u_y = b[2] + from_ray[2] * p_n + from_edge[2] * q;
        let along = u_x * e_x + u_y * e_y;
        let along_before = u_x * before_x + u_y * before_y;
        let outward = u_x * e_y - u_y * e_x;
        // At a corner the velocity turns back along both edges; on an edge it points inward, away from the outward normal.
        let mut follows = (at_corner + on_edge).at_least(one);
        for holds in [
            p_n.at_least(V::splat(f64::MIN_POSITIVE)),
            q.at_least(zero),
            (friction * p_n * length).at_least(q),
            zero.at_least(outward.replaced(corner, along_before)),
            zero.at_least(zero.replaced(corner, -along)),
            determinant.at_least(V::splat(f64::MIN_POSITIVE)),
        ] {
            follows = V::both(follows, holds);
        }
        for r in 0..3 {
            follows = V::both(follows, impulse[r].finite());
        }
        (impulse, follows)
    }

    fn project(&self, friction: f64, impulse: &Vector<R>) -> Vector<R> {
        let normal = impulse[0].max(0.0);
        let mut result = self.nearest(friction * normal, impulse);
        result[0] = normal;
        result
    }

    /// Contact by contact: the nearest point of a polygon is a search.
    #[inline(always)]
    fn natural_map<V: Lanes>(
        &self,
        friction: V,
        scale: V,
        impulse: &[V; R],
        velocity: &[V; R],
    ) -> [V; R] {
        let mut map = [V::Memory::filled(0.0); R];
        let (mut numbers, mut x) = ([V::Memory::filled(0.0); 2], map);
        friction.store(&mut numbers[0]);
        (scale * impulse[0]).store(&mut numbers[1]);
        for r in 0..R {
            (scale * impulse[r] - velocity[r]).store(&mut x[r]);
        }
        for lane in V::HELD {
            let [friction, push] = [numbers[0].get(lane), numbers[1].get(lane)];
            let mut here = [0.0; R];
            for r in 0..R {
                here[r] = x[r].get(lane);
            }
            let inside = self.nearest(friction * push.max(0.0), &here);
            map[0].set(lane, here[0] - here[0].max(0.0));
            for r in 1..R {
                map[r].set(lane, here[r] - inside[r]);
            }
        }
        // As for the cone: the velocity is not lost beside impulses that run off.
        let mut result = *velocity;
        for r in 0..R {
            result[r] = velocity[r] + V::load(&map[r]);
        }
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::samples::{Uniform, residual_after_step};

    fn regular(facets: usize) -> Polygon<3> {
        let angle = |j: usize| 2.0 * std::f64::consts::PI * j as f64 / facets as f64;
        Polygon::new(
            (0..facets)
                .map(|j| [0.0, angle(j).cos(), angle(j).sin()])
                .collect(),
        )
    }

    #[test]
    fn step_is_exact_with_moderate_coupling() {
        let mut random = Uniform(5);
        let square = Polygon::new(vec![
            [0.0, 1.0, 1.0],
            [0.0, -1.0, 1.0],
            [0.0, -1.0, -1.0],
            [0.0, 1.0, -1.0],
        ]);
        for polygon in [square, regular(3), regular(8), regular(13)] {
            for trial in 0..1000 {
                let friction = [0.0, 1e-9, 0.1, 0.5][trial % 4];
                let block = random.block::<3>(0.1);
                let residual = residual_after_step(&polygon, &block, friction, &mut random);
                assert!(residual < 1e-13, "{residual} in trial {trial}");
            }
        }
    }

    #[test]
    fn step_is_exact_in_the_plane() {
        let mut random = Uniform(6);
        let interval = Polygon::new(vec![[0.0, 1.0], [0.0, -1.0]]);
        for _ in 0..1000 {
            let block = random.block::<2>(0.2);
            assert!(residual_after_step(&interval, &block, 0.5, &mut random) < 1e-13);
        }
    }

    #[test]
    fn nearest_point_lies_in_the_polygon_and_a_point_inside_stays() {
        let mut random = Uniform(7);
        let polygon = regular(5);
        for _ in 0..1000 {
            let x: Vector<3> = random.vector();
            let point = polygon.nearest(0.4, &x);
            assert!(polygon.holds(0.4 + 1e-15, &point));
            let again = polygon.nearest(0.4, &point);
            assert!((1..3).all(|r| (again[r] - point[r]).abs() < 1e-15));
        }
    }
}
