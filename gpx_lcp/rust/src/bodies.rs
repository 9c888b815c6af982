//! What does not change while a world runs: shapes, masses and materials of its bodies. Bodies that move come first.

use std::ops::AddAssign;

use parry3d_f64::math::{Matrix, Pose, Vector};

use crate::collision::solid::Solid;
use crate::small_matrix::cholesky;

#[derive(Default)]
pub struct Bodies {
    /// How many bodies move; the others, after them, never do.
    pub moving: usize,
    /// None collides with nothing.
    pub solids: Vec<Option<Solid>>,
    pub materials: Vec<Material>,
    /// Of the moving bodies, kg.
    pub masses: Vec<f64>,
    /// Of the moving bodies, in the body's frame about its centre of mass, kg m²; zero for a body that does not rotate.
    pub inertias: Vec<Matrix>,
    /// Its inverse; zero for a body that does not rotate.
    pub inverse_inertias: Vec<Matrix>,
    /// Lower L with L Lᵀ that inverse.
    pub inverse_inertia_roots: Vec<Matrix>,
    /// Of the bodies that never move.
    pub fixed_poses: Vec<Pose>,
}

#[derive(Clone, Copy)]
pub struct Material {
    pub friction: f64,
    pub friction_rule: CombineRule,
    /// Along the normal and along the tangents, 1 plastic to 2 elastic: one more than the coefficient of restitution.
    pub elasticity: [f64; 2],
    pub elasticity_rule: CombineRule,
}

/// How two bodies' coefficients become the pair's. Of two bodies that name different rules, the later one here counts.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum CombineRule {
    /// (e1 m2 + e2 m1)/(m1 + m2): the founding formula in the frame of the pair's centre of mass.
    CentreOfMass,
    GeometricMean,
    Average,
    Minimum,
    Product,
    Maximum,
}

impl CombineRule {
    /// The rule of a number that Python's table of names gives.
    pub fn from_index(index: usize) -> Option<Self> {
        use CombineRule::*;
        [
            CentreOfMass,
            GeometricMean,
            Average,
            Minimum,
            Product,
            Maximum,
        ]
        .get(index)
        .copied()
    }

    fn combine(self, values: [f64; 2], masses: [f64; 2]) -> f64 {
        let [x, y] = values;
        match self {
            CombineRule::CentreOfMass if masses[0].is_infinite() => y,
            CombineRule::CentreOfMass if masses[1].is_infinite() => x,
            CombineRule::CentreOfMass => (x * masses[1] + y * masses[0]) / (masses[0] + masses[1]),
            CombineRule::GeometricMean => (x * y).sqrt(),
            CombineRule::Average => 0.5 * (x + y),
            CombineRule::Minimum => x.min(y),
            CombineRule::Product => x * y,
            CombineRule::Maximum => x.max(y),
        }
    }
}

impl Bodies {
    pub fn len(&self) -> usize {
        self.solids.len()
    }

    pub fn is_empty(&self) -> bool {
        self.solids.is_empty()
    }

    /// Whether these are two bodies of which at least one moves.
    pub fn may_touch(&self, [a, b]: [u32; 2]) -> bool {
        let (low, high) = (a.min(b) as usize, a.max(b) as usize);
        low < high && low < self.moving && high < self.len()
    }

    fn mass_or_infinity(&self, body: usize) -> f64 {
        self.masses.get(body).copied().unwrap_or(f64::INFINITY)
    }

    /// Radius of the ball about its centre of mass that holds a body; zero where it has no shape or no bounds.
    pub fn bound(&self, body: usize) -> f64 {
        self.solids[body].as_ref().map_or(0.0, Solid::bound)
    }

    /// Whether a body has a shape that no box holds.
    pub fn has_no_bounds(&self, body: usize) -> bool {
        matches!(self.solids[body], Some(Solid::HalfSpace { .. }))
    }

    /// Bounding radius of the smaller body of a pair.
    pub fn size(&self, pair: [u32; 2]) -> f64 {
        let [a, b] = pair.map(|body| self.bound(body as usize));
        if a == 0.0 { b } else { a.min(b) }
    }

    /// Coulomb's coefficient of a pair.
    pub fn friction(&self, pair: [u32; 2]) -> f64 {
        let [a, b] = pair.map(|body| self.materials[body as usize]);
        let rule = a.friction_rule.max(b.friction_rule);
        let masses = pair.map(|body| self.mass_or_infinity(body as usize));
        rule.combine([a.friction, b.friction], masses)
    }

    /// Restitutions of a pair, elasticity - 1, normal and tangential; the rules act on the restitutions.
    pub fn restitution(&self, pair: [u32; 2]) -> [f64; 2] {
        let [a, b] = pair.map(|body| self.materials[body as usize]);
        let rule = a.elasticity_rule.max(b.elasticity_rule);
        let masses = pair.map(|body| self.mass_or_infinity(body as usize));
        [0, 1].map(|axis| {
            let [x, y] = [a, b].map(|material| material.elasticity[axis] - 1.0);
            rule.combine([x, y], masses)
        })
    }
}

/// Where the moving bodies are and how they move, world frame.
#[derive(Clone, Default)]
pub struct State {
    pub poses: Vec<Pose>,
    pub velocities: Vec<Twist>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    /// Of the centre of mass, m/s.
    pub linear: Vector,
    /// rad/s.
    pub angular: Vector,
}

impl Twist {
    pub fn is_finite(&self) -> bool {
        self.linear.is_finite() && self.angular.is_finite()
    }
}

impl AddAssign for Twist {
    fn add_assign(&mut self, other: Self) {
        self.linear += other.linear;
        self.angular += other.angular;
    }
}

/// Lower L with L Lᵀ = `tensor`; zero for the zero tensor of a body that does not rotate.
pub fn root(tensor: &Matrix) -> Matrix {
    let rows = tensor.transpose().to_cols_array_2d();
    match cholesky(&rows, f64::MIN_POSITIVE) {
        Some(lower) => Matrix::from_cols_array_2d(&lower).transpose(),
        None => Matrix::ZERO,
    }
}
