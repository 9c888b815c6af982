//! Rows of contacts between rigid bodies, by the frame of each patch and the arms of each contact.
//!
//! With E the frame of a contact, r_a and r_b the arms from the centres of mass to its point, and (v, ω) what the impulses
//! have added to the velocities of a body,
//!
//! ```text
//! u = E (v_b + ω_b × r_b - v_a - ω_a × r_a) - B,        f = Eᵀ dp,
//! v_b += f/m_b,   ω_b += I_b⁻¹ (r_b × f),               v_a -= f/m_a,   ω_a -= I_a⁻¹ (r_a × f),
//! ```
//!
//! which is what the blocks of Ĵ do to whitened states, in as many operations. Of its own a contact has six numbers
//! instead of eighteen; frame, masses and inertias are those of its patch.

use std::mem::MaybeUninit;

use crate::abreast::{Place, Room, Rows, line};
use crate::colouring::NONE;
use crate::exact::BlockMatrix;
use crate::factored::{Source, Visit};
use crate::lanes::{LANES, Oct, OctLanes};
use crate::small_matrix::{Matrix, Vector, cross, dot};
use crate::stacking::MassRoot;

/// Entries of the frame, and of the mass and the inertia of both bodies, of a patch; the arms of a contact.
const FRAME: usize = 9;
const MASSES: usize = 7;
const SHARED: usize = FRAME + 2 * MASSES;
const OWN: usize = 6;
/// How far rows may be from those of an arm, as a share of it: rounding.
const ROUNDING: f64 = 1e-14;

/// J and M⁻¹ of rigid bodies, beside Ĵ.
#[derive(Clone, Copy)]
pub struct Rigid<'a> {
    /// Blocks of 3 × 6 in the places of those of Ĵ: ±e_k and ±r × e_k by rows, e_k an orthonormal frame.
    pub jacobian: &'a [f64],
    pub masses: Masses<'a>,
}

#[derive(Clone, Copy)]
pub enum Masses<'a> {
    /// L of each body, with M⁻¹ = L Lᵀ.
    Roots(&'a [MassRoot]),
    /// M⁻¹ in blocks of 6 × 6.
    Inverse(&'a [f64]),
}

impl Masses<'_> {
    /// 1/m, and the upper triangle of I⁻¹ row by row.
    fn of(&self, body: usize) -> [f64; MASSES] {
        match self {
            Masses::Roots(roots) => {
                let inertia = roots[body].of_rotation();
                let [x, y, z] = [0, 1, 2].map(|column| inertia.col(column));
                let mass = roots[body].of_translation();
                [mass, x[0], y[0], z[0], y[1], z[1], z[2]]
            }
            Masses::Inverse(blocks) => {
                let block = &blocks[36 * body..][..36];
                [(0, 0), (3, 3), (3, 4), (3, 5), (4, 4), (4, 5), (5, 5)]
                    .map(|(r, c)| block[6 * r + c])
            }
        }
    }
}

/// The rows of one block of J: where forces act, and their moments.
fn halves(block: &[f64]) -> [Matrix<3>; 2] {
    [0, 3].map(|first| std::array::from_fn(|r| std::array::from_fn(|d| block[6 * r + first + d])))
}

/// r of rows f_k and r × f_k, f_k being an orthonormal basis: 2 r = Σ f_k × (r × f_k).
fn arm([forces, moments]: &[Matrix<3>; 2]) -> Vector<3> {
    let turns: [Vector<3>; 3] = std::array::from_fn(|k| cross(&forces[k], &moments[k]));
    std::array::from_fn(|d| 0.5 * (turns[0][d] + turns[1][d] + turns[2][d]))
}

/// Whether J, in the places of Ĵ, and M⁻¹ in blocks are those of contacts between rigid bodies.
pub fn are_rigid(whitened: &BlockMatrix, jacobian: &[f64], inverse_mass: &[f64]) -> bool {
    (whitened.height, whitened.width) == (3, 6)
        && inverse_mass.chunks_exact(36).all(is_rigid_mass)
        && whitened.starts.windows(2).all(|places| {
            let blocks = jacobian[18 * places[0]..18 * places[1]].chunks_exact(18);
            is_rigid_contact(&whitened.columns[places[0]..places[1]], blocks.map(halves))
        })
}

/// Whether M⁻¹ has one mass, and an inertia that is apart from it.
fn is_rigid_mass(block: &[f64]) -> bool {
    (0..6).all(|r| {
        (0..6).all(|c| match (r < 3, c < 3) {
            (true, true) if r == c => block[6 * r + c] == block[0],
            (false, false) => block[6 * r + c] == block[6 * c + r],
            _ => block[6 * r + c] == 0.0,
        })
    })
}

fn is_rigid_contact(bodies: &[u32], blocks: impl Iterator<Item = [Matrix<3>; 2]>) -> bool {
    let mut first: Option<Matrix<3>> = None;
    for block in blocks {
        let [forces, moments] = &block;
        let arm = arm(&block);
        let reach = ROUNDING * dot(&arm, &arm).sqrt();
        let holds = (0..3).all(|k| {
            let moment = cross(&arm, &forces[k]);
            let unit = |other: usize| if other == k { 1.0 } else { 0.0 };
            (0..3).all(|d| (moment[d] - moments[k][d]).abs() <= reach)
                && (0..3)
                    .all(|other| (dot(&forces[k], &forces[other]) - unit(other)).abs() <= ROUNDING)
        });
        let opposes = first.is_none_or(|first| first == forces.map(|row| row.map(|x| -x)));
        if !(holds && opposes) {
            return false;
        }
        first = Some(*forces);
    }
    bodies.len() < 2 || bodies.len() == 2 && bodies[0] != bodies[1]
}

/// The rows of `Rigid`, on states (v, ω).
pub struct Arms;

#[inline(always)]
unsafe fn three<V: OctLanes>(rows: &[MaybeUninit<Oct>], at: usize) -> [V; 3] {
    // SAFETY: the caller's promise.
    unsafe { [line(rows, at), line(rows, at + 1), line(rows, at + 2)] }
}

impl Rows<3, 6> for Arms {
    const LINES: usize = SHARED + OWN;

    #[inline(always)]
    unsafe fn velocity<V: OctLanes>(
        rows: &[MaybeUninit<Oct>],
        place: Place,
        free: &[Oct; 3],
        states: &[[V; 6]; 2],
    ) -> [V; 3] {
        let mut moves = [[V::splat(0.0); 3]; 2];
        for side in 0..2 {
            // SAFETY: the caller's promise, here and below.
            let arm = unsafe { three::<V>(rows, place.own as usize + 3 * side) };
            let [x, y, z, turn_x, turn_y, turn_z] = states[side];
            moves[side] = [
                x.plus_product(turn_y, arm[2]).minus_product(turn_z, arm[1]),
                y.plus_product(turn_z, arm[0]).minus_product(turn_x, arm[2]),
                z.plus_product(turn_x, arm[1]).minus_product(turn_y, arm[0]),
            ];
        }
        let mut velocity = [V::splat(0.0); 3];
        for r in 0..3 {
            let frame = unsafe { three::<V>(rows, place.shared as usize + 3 * r) };
            velocity[r] = V::load(&free[r]);
            for d in 0..3 {
                velocity[r] = velocity[r].plus_product(frame[d], moves[1][d] - moves[0][d]);
            }
        }
        velocity
    }

    #[inline(always)]
    unsafe fn add<V: OctLanes>(
        rows: &[MaybeUninit<Oct>],
        place: Place,
        change: &[V; 3],
        states: &mut [[V; 6]; 2],
    ) {
        let mut force = [V::splat(0.0); 3];
        for r in 0..3 {
            // SAFETY: the caller's promise, here and below.
            let frame = unsafe { three::<V>(rows, place.shared as usize + 3 * r) };
            for d in 0..3 {
                force[d] = force[d].plus_product(frame[d], change[r]);
            }
        }
        for side in 0..2 {
            let mut pushes = force;
            if side == 0 {
                pushes = [-force[0], -force[1], -force[2]];
            }
            let arm = unsafe { three::<V>(rows, place.own as usize + 3 * side) };
            let moment = cross(&arm, &pushes);
            let first = place.shared as usize + FRAME + MASSES * side;
            let mass = unsafe { line::<V>(rows, first) };
            for d in 0..3 {
                states[side][d] = states[side][d].plus_product(mass, pushes[d]);
            }
            let [[xx, xy, xz], [yy, yz, zz]] =
                unsafe { [three::<V>(rows, first + 1), three::<V>(rows, first + 4)] };
            for (d, row) in [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
                .iter()
                .enumerate()
            {
                for c in 0..3 {
                    states[side][3 + d] = states[side][3 + d].plus_product(row[c], moment[c]);
                }
            }
        }
    }
}

impl Source<3, 6> for Rigid<'_> {
    type Rows = Arms;

    fn write(
        &self,
        whitened: &BlockMatrix,
        visit: &Visit<3, 6>,
        shared: Option<u32>,
        room: &mut Room<3>,
    ) -> Place {
        let mut frames = [Oct::default(); FRAME];
        let mut arms = [Oct::default(); OWN];
        for lane in (0..LANES).filter(|&lane| visit.numbers[lane] != NONE) {
            let contact = visit.numbers[lane] as usize;
            for place in whitened.starts[contact]..whitened.starts[contact + 1] {
                let side = usize::from(visit.bodies[lane][0] != whitened.columns[place]);
                let block = halves(&self.jacobian[18 * place..][..18]);
                for (d, value) in arm(&block).into_iter().enumerate() {
                    arms[3 * side + d].0[lane] = value;
                }
                let sign = if side == 0 { -1.0 } else { 1.0 };
                for (entry, value) in frames.iter_mut().zip(block[0].as_flattened()) {
                    entry.0[lane] = sign * value;
                }
            }
        }
        let holds = |&begin: &u32| visit.are_in(room.rows(begin, FRAME), frames.into_iter());
        let shared = shared.filter(holds).unwrap_or_else(|| {
            let mut masses = [Oct::default(); 2 * MASSES];
            for (lane, bodies) in visit.bodies.iter().enumerate() {
                for (side, &body) in bodies.iter().enumerate().filter(|(_, body)| **body != NONE) {
                    for (entry, value) in self.masses.of(body as usize).into_iter().enumerate() {
                        masses[MASSES * side + entry].0[lane] = value;
                    }
                }
            }
            room.add_rows(frames.into_iter().chain(masses))
        });
        let own = room.add_rows(arms.into_iter());
        Place { shared, own }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::samples::Uniform;
    use crate::factored::{Blocks, Factored};
    use crate::friction_cone::Coulomb;
    use crate::gauss_seidel::{Outcome, Problem, Settings, solve};
    use crate::small_matrix::{cholesky, transposed};

    const BODIES: usize = 12;

    /// Contacts of patches of up to three between random bodies, or one and the ground: Ĵ, J and M⁻¹.
    fn patches(random: &mut Uniform) -> (BlockMatrix, Vec<f64>, Vec<f64>) {
        let mut inverse_mass = vec![0.0; 36 * BODIES];
        let mut roots = Vec::new();
        for block in inverse_mass.chunks_exact_mut(36) {
            let (mass, inertia) = (1.5 + random.draw(), random.block::<3>(0.2));
            let size = inertia[0][0];
            let inertia = inertia.map(|row| row.map(|value| value / size));
            for r in 0..3 {
                block[7 * r] = mass;
                for c in 0..3 {
                    block[6 * (3 + r) + 3 + c] = 0.5 * (inertia[r][c] + inertia[c][r]);
                }
            }
            // The columns of L, in rows.
            roots.push((mass.sqrt(), transposed(&cholesky(&inertia, 0.0).unwrap())));
        }
        let (mut starts, mut columns) = (vec![0], Vec::new());
        let (mut jacobian, mut whitened) = (Vec::new(), Vec::new());
        for patch in 0..40 {
            let first = patch % BODIES;
            let second = (patch % 5 > 0).then_some((first + 1 + patch % 4) % BODIES);
            let frame = frame(&random.vector(), &random.vector());
            for _ in 0..1 + patch % 3 {
                for (body, sign) in [(Some(first), -1.0), (second, 1.0)] {
                    let Some(body) = body else { continue };
                    columns.push(body as u32);
                    let arm: Vector<3> = random.vector();
                    for row in frame {
                        let force = row.map(|value| sign * value);
                        let moment = cross(&arm, &force);
                        jacobian.extend(force.into_iter().chain(moment));
                        whitened.extend(force.map(|value| roots[body].0 * value));
                        whitened.extend(roots[body].1.iter().map(|column| dot(column, &moment)));
                    }
                }
                starts.push(columns.len());
            }
        }
        let matrix = BlockMatrix::new(starts, columns, whitened, (3, 6), BODIES).unwrap();
        (matrix, jacobian, inverse_mass)
    }

    fn frame(x: &Vector<3>, y: &Vector<3>) -> Matrix<3> {
        let unit = |x: Vector<3>| x.map(|value| value / dot(&x, &x).sqrt());
        let normal = unit(*x);
        let tangent = unit(cross(&normal, y));
        [normal, tangent, cross(&normal, &tangent)]
    }

    /// Thirty sweeps from nothing.
    fn swept<S: Source<3, 6>>(matrix: &BlockMatrix, source: S, acceleration: bool) -> Outcome<3> {
        let contacts = matrix.starts.len() - 1;
        let mut random = Uniform(3);
        let target: Vec<Vector<3>> = (0..contacts).map(|_| random.vector()).collect();
        let problem = Problem {
            target: &target,
            friction: &vec![0.5; contacts],
            scale: &vec![1.0; contacts],
            target_norm: 1.0,
        };
        let settings = Settings {
            tolerance: 0.0,
            max_sweeps: 30,
            time_limit: None,
            relaxation: 1.0,
            acceleration,
            threads: 1,
        };
        let delassus = Factored::<3, 6, S>::new(matrix, source).unwrap();
        let start = vec![[0.0; 3]; contacts];
        solve(
            &delassus,
            &Coulomb,
            &problem,
            &start,
            &settings,
            &mut || true,
        )
    }

    #[test]
    fn arms_do_what_blocks_do() {
        let (matrix, jacobian, inverse_mass) = patches(&mut Uniform(2));
        assert!(are_rigid(&matrix, &jacobian, &inverse_mass));
        for acceleration in [false, true] {
            let rigid = Rigid {
                jacobian: &jacobian,
                masses: Masses::Inverse(&inverse_mass),
            };
            let by_arms = swept(&matrix, rigid, acceleration);
            let by_blocks = swept(&matrix, Blocks, acceleration);
            assert!(by_blocks.impulse.iter().any(|p| p[0] > 0.1));
            for (p, q) in by_arms.impulse.iter().zip(&by_blocks.impulse) {
                assert!((0..3).all(|r| (p[r] - q[r]).abs() < 1e-11), "{p:?} {q:?}");
            }
            let last = |outcome: &Outcome<3>| outcome.history[3].1;
            assert!((last(&by_arms) - last(&by_blocks)).abs() < 1e-11);
        }
    }

    #[test]
    fn what_is_not_of_rigid_bodies_is_told_apart() {
        let (matrix, jacobian, inverse_mass) = patches(&mut Uniform(2));
        let mut bent = jacobian.clone();
        bent[4] += 1e-9;
        assert!(!are_rigid(&matrix, &bent, &inverse_mass));
        // A row that is no moment of an arm, and one that is no unit vector.
        let mut long = jacobian.clone();
        long[..6].iter_mut().for_each(|value| *value *= 1.001);
        assert!(!are_rigid(&matrix, &long, &inverse_mass));
        let mut uneven = inverse_mass.clone();
        uneven[7] *= 2.0;
        assert!(!are_rigid(&matrix, &jacobian, &uneven));
        let mut coupled = inverse_mass;
        (coupled[3], coupled[18]) = (0.1, 0.1);
        assert!(!are_rigid(&matrix, &jacobian, &coupled));
    }
}
