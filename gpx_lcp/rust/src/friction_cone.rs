//! The two laws on the friction cone K = {‖p_t‖ ≤ μ p_n}: Coulomb's own, and its convex relaxation.
//!
//! Both slide on the boundary of the cone, with u_t = -α p_t for some α > 0 that one scalar equation determines.

use crate::contact::{Contact, Law};
use crate::heading::follow;
use crate::lanes::Lanes;
use crate::small_matrix::{
    Matrix, Vector, cholesky, dot, lower_inverse, symmetric_eigen, tangent_length, transposed,
};

/// Exact Coulomb law: K ∋ p ⟂ û ∈ K*, û = u + μ‖u_t‖ n.
pub struct Coulomb;

/// Convex relaxation: K ∋ p ⟂ u ∈ K*, the optimality condition of min ½ pᵀA p - pᵀB over the cones. Sliding opens.
pub struct ConvexCone;

/// The tangential part of A_ii after elimination of the normal row, S = A_tt - A_tn A_nt/A_nn, diagonalised.
pub struct SlidingBasis<const R: usize> {
    /// Eigenvectors of S in rows; entry 0 of each, and row 0, belong to the normal and are not used.
    directions: Matrix<R>,
    stiffness: Vector<R>,
    /// A_nt in that basis.
    coupling: Vector<R>,
    /// α of the last exact slide.
    last: f64,
}

/// A_ii and D = diag(-μ², 1, 1) diagonalised together: VᵀA V = 1, VᵀD V = |λ₀| diag(-1, κ₁, κ₂).
pub struct ConeBasis<const R: usize> {
    vectors: Matrix<R>,
    kappa: Vector<R>,
    /// The unknown of the last slide, for g₀ ≥ 0 and g₀ < 0.
    last: [f64; 2],
}

impl<const R: usize> SlidingBasis<R> {
    fn of(contact: &Contact<f64, R>) -> Self {
        let block = contact.block();
        let mut reduced = [[0.0; R]; R];
        for r in 1..R {
            for c in 1..R {
                reduced[r][c] = block[r][c] - block[r][0] * block[0][c] / block[0][0];
            }
        }
        let (stiffness, vectors) = symmetric_eigen(&reduced);
        let directions = transposed(&vectors);
        let mut coupling = [0.0; R];
        for k in 1..R {
            coupling[k] = (1..R).map(|r| directions[k][r] * block[0][r]).sum();
        }
        Self {
            directions,
            stiffness,
            coupling,
            last: 0.0,
        }
    }
}

impl<const R: usize> Law<R> for Coulomb {
    /// In a box: few contacts ever need theirs.
    type Local = Option<Box<SlidingBasis<R>>>;

    #[inline(always)]
    fn contains<V: Lanes>(&self, friction: V, impulse: &[V; R]) -> V::Mask {
        in_cone(friction, impulse)
    }

    /// μ‖b_t‖ ≤ b_n + μ‖b_t‖: the correction makes only the normal matter.
    #[inline(always)]
    fn separates<V: Lanes>(&self, _friction: V, b: &[V; R]) -> V::Mask {
        b[0].at_least(V::splat(0.0))
    }

    /// Solve u_n = 0, u_t = -α p_t, ‖p_t‖ = μ p_n for α > 0.
    ///
    /// With c = b_t - A_tn b_n/A_nn: p_t(α) = -(S + α)⁻¹ c and p_n(α) = -(b_n + A_nt p_t)/A_nn. The equation is posed as
    /// h(α) = μ p_n/‖p_t‖ - 1 = 0, which is linear in α where S is a multiple of the identity. h(0) < 0, because the
    /// sticking impulse lies outside the cone, and h grows beyond bounds with α, because b_n < 0: there is a root.
    /// It is the only one unless friction and coupling are so strong that sliding itself is ambiguous (Painlevé).
    #[inline(never)]
    fn slide(
        &self,
        contact: &Contact<f64, R>,
        local: &mut Option<Box<SlidingBasis<R>>>,
        b: &Vector<R>,
    ) -> Option<Vector<R>> {
        let local = local.get_or_insert_with(|| Box::new(SlidingBasis::of(contact)));
        let normal = *contact.block_at(0, 0);
        let mut reduced = [0.0; R];
        for r in 1..R {
            reduced[r] = b[r] - contact.block_at(r, 0) * b[0] / normal;
        }
        let mut c = [0.0; R];
        for k in 1..R {
            c[k] = (1..R).map(|r| local.directions[k][r] * reduced[r]).sum();
        }
        let mut softest = f64::INFINITY;
        for k in 1..R {
            softest = softest.min(local.stiffness[k]);
        }
        let alpha = increasing_root(local.last, softest, |alpha| {
            let (mut square, mut square_slope, mut pull, mut pull_slope) = (0.0, 0.0, 0.0, 0.0);
            for k in 1..R {
                let soft = 1.0 / (local.stiffness[k] + alpha);
                let part = c[k] * soft;
                square += part * part;
                square_slope -= part * part * soft;
                pull -= local.coupling[k] * part;
                pull_slope += local.coupling[k] * part * soft;
            }
            let length = square.sqrt();
            let p_n = -(b[0] + pull) / normal;
            let ratio = contact.friction * p_n / length;
            (
                ratio - 1.0,
                -contact.friction * pull_slope / (normal * length) - ratio * square_slope / square,
            )
        });
        local.last = alpha;
        let mut impulse = [0.0; R];
        for r in 1..R {
            impulse[r] = -(1..R)
                .map(|k| local.directions[k][r] * c[k] / (local.stiffness[k] + alpha))
                .sum::<f64>();
        }
        impulse[0] = -(b[0]
            + (1..R)
                .map(|r| contact.block_at(0, r) * impulse[r])
                .sum::<f64>())
            / normal;
        Some(onto_boundary(contact.friction, &impulse))
    }

    #[inline(always)]
    fn slide_on<V: Lanes>(
        &self,
        contact: &mut Contact<V::Memory, R>,
        _locals: &[Option<Box<SlidingBasis<R>>>],
        b: &[V; R],
        wanted: u32,
    ) -> ([V; R], V::Mask) {
        follow::<V, R, false>(contact, b, wanted)
    }

    #[inline]
    fn project(&self, friction: f64, impulse: &Vector<R>) -> Vector<R> {
        project(friction, impulse)
    }

    #[inline(always)]
    fn natural_map<V: Lanes>(
        &self,
        friction: V,
        scale: V,
        impulse: &[V; R],
        velocity: &[V; R],
    ) -> [V; R] {
        let mut corrected = *velocity;
        corrected[0] = velocity[0] + friction * tangent_length(velocity);
        natural_map(friction, scale, impulse, &corrected)
    }
}

impl<const R: usize> ConeBasis<R> {
    /// The basis of a contact with friction; None where rounding leaves the block no factor.
    fn of(contact: &Contact<f64, R>) -> Option<Self> {
        let lower = cholesky(&contact.block(), 0.0)?;
        let inverse = lower_inverse(&lower);
        let sign = |k: usize| {
            if k == 0 {
                -contact.friction * contact.friction
            } else {
                1.0
            }
        };
        let whitened: Matrix<R> = std::array::from_fn(|r| {
            std::array::from_fn(|c| {
                (0..R)
                    .map(|k| inverse[r][k] * sign(k) * inverse[c][k])
                    .sum()
            })
        });
        let (values, vectors) = symmetric_eigen(&whitened);
        let mut order: [usize; R] = std::array::from_fn(|k| k);
        order.sort_by(|&x, &y| values[x].total_cmp(&values[y]));
        let mut basis: Matrix<R> = std::array::from_fn(|r| {
            std::array::from_fn(|k| (0..R).map(|j| inverse[j][r] * vectors[j][order[k]]).sum())
        });
        // The axis of K must have a positive first coordinate, V⁻¹ n = Vᵀ A n, so that y₀ > 0 tells K from -K.
        if (0..R)
            .map(|r| basis[r][0] * contact.block_at(r, 0))
            .sum::<f64>()
            < 0.0
        {
            for row in &mut basis {
                row[0] = -row[0];
            }
        }
        let negative = values[order[0]].abs();
        Some(Self {
            vectors: basis,
            kappa: std::array::from_fn(|k| values[order[k]] / negative),
            last: [1.0, 0.0],
        })
    }
}

impl<const R: usize> Law<R> for ConvexCone {
    /// In a box: few contacts ever need theirs.
    type Local = Option<Box<ConeBasis<R>>>;

    #[inline(always)]
    fn contains<V: Lanes>(&self, friction: V, impulse: &[V; R]) -> V::Mask {
        in_cone(friction, impulse)
    }

    /// b lies in the dual cone, μ‖b_t‖ ≤ b_n.
    #[inline(always)]
    fn separates<V: Lanes>(&self, friction: V, b: &[V; R]) -> V::Mask {
        let mut scaled = *b;
        for r in 1..R {
            scaled[r] = friction * b[r];
        }
        in_cone(V::splat(1.0), &scaled)
    }

    /// Solve u = -α D p, pᵀD p = 0, p_n > 0 for α > 0, D = diag(-μ², 1, 1).
    ///
    /// In the basis that diagonalises A and D, with g = Vᵀb and β = α|λ₀|: y₀ = -g₀/(1 - β),
    /// y_k = -g_k/(1 + βκ_k), and the cone is y₀ = N(β) = √Σ κ_k y_k². On the side of the upper half cone β lies in
    /// (0, 1) when g₀ < 0 and in (1, ∞) when g₀ > 0. In δ = 1/|1 - β| the equation h = δ|g₀|/N - 1 = 0 is increasing,
    /// and linear where κ₁ = κ₂. The unknown is x > 0 with δ = 1 + x in the first case and δ = x in the second, so
    /// that a small β, which small friction brings, keeps its digits.
    #[inline(never)]
    fn slide(
        &self,
        contact: &Contact<f64, R>,
        local: &mut Option<Box<ConeBasis<R>>>,
        b: &Vector<R>,
    ) -> Option<Vector<R>> {
        if local.is_none() {
            *local = ConeBasis::of(contact).map(Box::new);
        }
        let local = local.as_mut()?;
        let columns = transposed(&local.vectors);
        let g: Vector<R> = std::array::from_fn(|k| dot(&columns[k], b));
        let before = g[0] < 0.0;
        let (side, first) = if before { (1.0, 1.0) } else { (-1.0, 0.0) };
        let beta_of = |x: f64| if before { x / (1.0 + x) } else { 1.0 + 1.0 / x };
        // A vanishing g₀ has its root at x = ∞, β = 1; the search then ends where β differs from 1 by rounding alone.
        let x = increasing_root(local.last[before as usize], 1.0, |x| {
            let (beta, delta) = (beta_of(x), first + x);
            let (mut square, mut slope) = (0.0, 0.0);
            for k in 1..R {
                let soft = 1.0 / (1.0 + beta * local.kappa[k]);
                let part = g[k] * soft;
                square += local.kappa[k] * part * part;
                slope -= local.kappa[k] * local.kappa[k] * part * part * soft;
            }
            let rate = g[0].abs() / square.sqrt();
            (
                delta * rate - 1.0,
                rate * (1.0 - side * slope / (square * delta)),
            )
        });
        local.last[before as usize] = x;
        let beta = beta_of(x);
        let mut y = [0.0; R];
        for k in 1..R {
            y[k] = -g[k] / (1.0 + beta * local.kappa[k]);
        }
        y[0] = (1..R)
            .map(|k| local.kappa[k] * y[k] * y[k])
            .sum::<f64>()
            .sqrt();
        let impulse: Vector<R> = std::array::from_fn(|r| dot(&local.vectors[r], &y));
        Some(onto_boundary(contact.friction, &impulse))
    }

    #[inline(always)]
    fn slide_on<V: Lanes>(
        &self,
        contact: &mut Contact<V::Memory, R>,
        _locals: &[Option<Box<ConeBasis<R>>>],
        b: &[V; R],
        wanted: u32,
    ) -> ([V; R], V::Mask) {
        follow::<V, R, true>(contact, b, wanted)
    }

    #[inline]
    fn project(&self, friction: f64, impulse: &Vector<R>) -> Vector<R> {
        project(friction, impulse)
    }

    #[inline(always)]
    fn natural_map<V: Lanes>(
        &self,
        friction: V,
        scale: V,
        impulse: &[V; R],
        velocity: &[V; R],
    ) -> [V; R] {
        natural_map(friction, scale, impulse, velocity)
    }
}

/// Root of h in (0, ∞) by Newton's method kept inside a bracket; h(0) < 0 and h is positive far out.
///
/// `h` returns its value and its slope. Where no step can be taken the last point is returned: the caller's result is
/// judged by the residual like any other.
#[inline(always)]
fn increasing_root(start: f64, stride: f64, h: impl Fn(f64) -> (f64, f64)) -> f64 {
    let (mut low, mut high, mut x) = (0.0, f64::INFINITY, start);
    for _ in 0..100 {
        let (value, slope) = h(x);
        if value.is_nan() {
            break;
        }
        if value < 0.0 {
            low = x;
        } else {
            high = x;
        }
        let newton = x - value / slope;
        let inside = newton > low && newton < high;
        // h is nearly linear and Newton's error is squared: what this step leaves is of the order of 1e-12 or less, and
        // the next visit starts from it.
        if value.abs() <= 1e-6 {
            return if inside { newton } else { x };
        }
        let next = if inside {
            newton
        } else if high.is_finite() {
            low + 0.5 * (high - low)
        } else {
            2.0 * x + stride
        };
        if (next - x).abs() <= f64::EPSILON * x.abs() || !next.is_finite() {
            break;
        }
        x = next;
    }
    x
}

#[inline(always)]
fn in_cone<V: Lanes, const R: usize>(friction: V, impulse: &[V; R]) -> V::Mask {
    let mut square = V::splat(0.0);
    for r in 1..R {
        square = square.plus_product(impulse[r], impulse[r]);
    }
    let bound = friction * impulse[0];
    V::both(
        impulse[0].at_least(V::splat(0.0)),
        (bound * bound).at_least(square),
    )
}

/// Undo the rounding of a root: the same normal impulse, with friction of exactly μ p_n.
fn onto_boundary<const R: usize>(friction: f64, impulse: &Vector<R>) -> Vector<R> {
    let length = tangent_length(impulse);
    let mut result = *impulse;
    result[0] = impulse[0].max(0.0);
    let shrink = if length > 0.0 {
        friction * result[0] / length
    } else {
        0.0
    };
    for value in &mut result[1..] {
        *value *= shrink;
    }
    result
}

/// Exact projection onto the friction cone.
#[inline(always)]
pub fn project<V: Lanes, const R: usize>(friction: V, x: &[V; R]) -> [V; R] {
    let (zero, length) = (V::splat(0.0), tangent_length(x));
    let inside = (friction * x[0]).at_least(length);
    if V::all(V::both(inside, x[0].at_least(zero))) {
        return *x;
    }
    let polar = (-x[0]).at_least(friction * length);
    let normal = (x[0] + friction * length) / (V::splat(1.0) + friction * friction);
    let shrink = friction * normal / length;
    let mut result = *x;
    for r in 0..R {
        let boundary = if r == 0 { normal } else { x[r] * shrink };
        // The polar cone last: without friction or tangent the two tests overlap on the negative normals.
        result[r] = boundary.replaced(inside, x[r]).replaced(polar, zero);
    }
    result
}

/// d p - P_K(d p - û) as û + (x - P_K(x)), whose second term is zero inside the cone: û is not lost beside impulses that
/// run off.
#[inline(always)]
fn natural_map<V: Lanes, const R: usize>(
    friction: V,
    scale: V,
    impulse: &[V; R],
    velocity: &[V; R],
) -> [V; R] {
    let mut x = *impulse;
    for r in 0..R {
        x[r] = scale * impulse[r] - velocity[r];
    }
    let inside = project(friction, &x);
    let mut map = *velocity;
    for r in 0..R {
        map[r] = velocity[r] + (x[r] - inside[r]);
    }
    map
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::samples::{Uniform, residual_after_step};

    const FRICTIONS: [f64; 5] = [0.0, 1e-9, 0.1, 0.5, 1.0];

    #[test]
    fn coulomb_step_is_exact_with_moderate_coupling() {
        let mut random = Uniform(1);
        for trial in 0..4000 {
            let friction = FRICTIONS[trial % 5];
            let block = random.block::<3>(0.2);
            let residual = residual_after_step(&Coulomb, &block, friction, &mut random);
            assert!(residual < 1e-13, "{residual} in trial {trial}");
            let block = random.block::<2>(0.2);
            assert!(residual_after_step(&Coulomb, &block, friction, &mut random) < 1e-13);
        }
    }

    #[test]
    fn cone_step_is_exact_with_any_coupling() {
        let mut random = Uniform(2);
        for trial in 0..4000 {
            let friction = FRICTIONS[trial % 5];
            let block = random.block::<3>(1.0);
            let residual = residual_after_step(&ConvexCone, &block, friction, &mut random);
            assert!(residual < 1e-11, "{residual} in trial {trial}");
            let block = random.block::<2>(1.0);
            assert!(residual_after_step(&ConvexCone, &block, friction, &mut random) < 1e-11);
        }
    }

    #[test]
    fn one_row_has_no_friction() {
        let mut random = Uniform(3);
        for _ in 0..100 {
            let block = random.block::<1>(1.0);
            assert!(residual_after_step(&Coulomb, &block, 0.0, &mut random) < 1e-15);
        }
    }

    #[test]
    fn projection_is_idempotent_and_leaves_a_polar_remainder() {
        let mut random = Uniform(4);
        for friction in FRICTIONS {
            for _ in 0..500 {
                let x: Vector<3> = random.vector();
                let p = project(friction, &x);
                let again = project(friction, &p);
                let rest: Vector<3> = std::array::from_fn(|r| x[r] - p[r]);
                assert!((0..3).all(|r| (again[r] - p[r]).abs() < 1e-15));
                assert!(dot(&p, &rest).abs() < 1e-15);
                assert!(friction * tangent_length(&rest) <= -rest[0] + 1e-15);
            }
        }
    }

    #[test]
    fn negative_normal_is_outside_without_friction_too() {
        assert_eq!(project(0.0, &[-1.0, 0.0, 0.0]), [0.0; 3]);
        assert_eq!(project(0.0, &[-1.0]), [0.0]);
    }
}
