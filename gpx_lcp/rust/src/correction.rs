//! Overlap is taken out of positions, never of velocities: a projection that moves the bodies as little as can be,
//!
//! ```text
//! min ½ Σ_b w_b Δx_bᵀ M_b Δx_b    over J_n Δx ≥ a,
//! ```
//!
//! with a_k a share of what contact k overlaps by at the end of the step, and minus the gap where it has one. What the
//! sweeps leave of it, the next step takes out.
//!
//! The level of a body is how many contacts lie between it and what never moves, and w falls by the same factor from level
//! to level: what stands on others gives way before they do. Contacts are visited from below. Each sweep then brings two
//! more levels of a stack to where they belong; with w = 1 so many sweeps reach no more than their root, and a stack that
//! is lifted halfway tilts. Bodies that hold on to nothing have w = 1, so that their centre of mass stays.
//!
//! Source: E. Guendelman, R. Bridson, R. Fedkiw, *Nonconvex rigid bodies with stacking*, ACM Transactions on Graphics 22
//! (2003), where what is below has no end of mass. Here it has a factor more, so that who is wedged in below gets out.

use parry3d_f64::math::Pose;

use crate::bodies::{Bodies, Twist};
use crate::collision::Contact;
use crate::stacking::{Stack, relative_velocity};

/// Overlap that is left alone, as a share of the smaller body's bounding radius: 0.09 mm for a cube of 1 m.
const SLOP: f64 = 1e-4;
/// The share of the overlap beyond that which one step takes out.
const CORRECTION: f64 = 0.2;
/// How much lighter a body counts than one of the level below.
///
/// Of 2, 3, 4 and 16: thirty cubes, 1 cm in each other, end 5, 0.4 and 0.01 mm beside their line with the first three.
/// With 16, a wall of 10 000 bricks that its sweeps do not hold comes apart: a brick that tilts lifts the next one more.
const LIGHTER: f64 = 3.0;
/// Where sweeps end early: where they change less than this share of what is asked.
const TOLERANCE: f64 = 1e-4;
/// And where at the latest: walls of 20 to 141 rows that sink do not stand better with fifty.
const SWEEPS: usize = 30;

/// A body of no contact with anything that holds on to what never moves, directly or through others.
const LOOSE: u32 = u32::MAX;

/// The velocities, for this step's poses only, that take out overlap after a step that moves the bodies at `velocities`;
/// None where no contact overlaps by more than is left alone.
pub fn position_shift(
    bodies: &Bodies,
    contacts: &[Contact],
    stack: &Stack,
    poses: &[Pose],
    velocities: &[Twist],
    time_step: f64,
) -> Option<Vec<Twist>> {
    let ends = contacts.iter().map(|contact| {
        let closing = relative_velocity(bodies, contact, poses, velocities).dot(contact.frame[0]);
        let slop = SLOP * bodies.size(contact.bodies);
        (contact.gap + time_step * closing, slop)
    });
    if ends.clone().all(|(gap, slop)| gap >= -slop) {
        return None;
    }
    let asked: Vec<f64> = ends
        .map(|(gap, slop)| {
            if gap < -slop {
                CORRECTION * (-gap - slop) / time_step
            } else {
                -gap.max(0.0) / time_step
            }
        })
        .collect();
    let pairs: Vec<[u32; 2]> = contacts.iter().map(|contact| contact.bodies).collect();
    let levels = levels(&pairs, bodies.moving);
    let order = from_below(&pairs, &levels);
    let states = sweep(stack, &pairs, &levels, &order, &asked);
    let moving = stack.roots.iter().zip(&states);
    Some(moving.map(|(root, state)| root.twist(state)).collect())
}

/// The level of each body, the fixed ones at level zero: contacts away from them.
fn levels(pairs: &[[u32; 2]], moving: usize) -> Vec<u32> {
    let moves = |body: u32| (body as usize) < moving;
    let mut levels = vec![LOOSE; moving];
    let mut found = Vec::new();
    // The neighbours of each body, one body after the other.
    let mut ends = vec![0; moving + 1];
    for &[a, b] in pairs {
        match [moves(a), moves(b)] {
            [true, true] => {
                ends[a as usize + 1] += 1;
                ends[b as usize + 1] += 1;
            }
            [true, false] => found.push(a),
            [false, true] => found.push(b),
            [false, false] => {}
        }
    }
    for body in 0..moving {
        ends[body + 1] += ends[body];
    }
    let mut begins = ends.clone();
    let mut neighbours = vec![0; ends[moving]];
    for &[a, b] in pairs
        .iter()
        .filter(|pair| pair.iter().all(|&body| moves(body)))
    {
        for (body, other) in [(a, b), (b, a)] {
            neighbours[begins[body as usize]] = other;
            begins[body as usize] += 1;
        }
    }
    let mut level = 0;
    while !found.is_empty() {
        level += 1;
        found.retain(|&body| {
            let first = levels[body as usize] == LOOSE;
            if first {
                levels[body as usize] = level;
            }
            first
        });
        let next = found.iter().flat_map(|&body| {
            let body = body as usize;
            neighbours[ends[body]..ends[body + 1]].iter().copied()
        });
        found = next.collect();
    }
    levels
}

/// The level of a body as its contacts are put in order by it, given those of all that move.
fn level(levels: &[u32], body: u32) -> u32 {
    match levels.get(body as usize) {
        None => 0,
        Some(&LOOSE) => 1,
        Some(&level) => level,
    }
}

/// The contacts in the order of their visits: by the level of the lower body, then by that of the other one.
fn from_below(pairs: &[[u32; 2]], levels: &[u32]) -> Vec<u32> {
    let ends = |pair: &[u32; 2]| {
        let [a, b] = pair.map(|body| level(levels, body));
        [a.min(b), a.max(b)]
    };
    let ends: Vec<[u32; 2]> = pairs.iter().map(ends).collect();
    let mut order: Vec<u32> = (0..pairs.len() as u32).collect();
    // There are few levels: contacts are counted by one end, and then, in the order they are in, by the other.
    for end in [1, 0] {
        let level = |contact: u32| ends[contact as usize][end] as usize;
        let mut places = vec![0; order.iter().fold(0, |most, &k| most.max(level(k))) + 2];
        for &contact in &order {
            places[level(contact) + 1] += 1;
        }
        for level in 1..places.len() {
            places[level] += places[level - 1];
        }
        let mut next = vec![0; order.len()];
        for contact in order {
            let place = &mut places[level(contact)];
            next[*place] = contact;
            *place += 1;
        }
        order = next;
    }
    order
}

/// What a visit reads and writes of one contact, on its normal.
struct Side {
    /// Ĵ_n of both bodies, zero where there is none.
    rows: [[f64; 6]; 2],
    bodies: [u32; 2],
    /// 1/w of both, as a multiple of that of the lower body.
    gains: [f64; 2],
    /// d = Ĵ_n w⁻¹ Ĵ_nᵀ, 1/kg, and 1/d; both zero for a contact between locked bodies.
    stiffness: f64,
    response: f64,
    /// N s, as a multiple of w of the lower body.
    impulse: f64,
}

impl Side {
    fn of(contact: usize, pair: [u32; 2], levels: &[u32], stack: &Stack) -> Self {
        let lowest = level(levels, pair[0]).min(level(levels, pair[1]));
        let nobody = levels.len() as u32;
        let mut side = Self {
            rows: [[0.0; 6]; 2],
            bodies: [nobody; 2],
            gains: [1.0; 2],
            stiffness: 0.0,
            response: 0.0,
            impulse: 0.0,
        };
        let columns = stack.layout.columns;
        for (k, (body, block)) in stack.whitened.row(contact).enumerate() {
            let body = body as u32;
            side.rows[k][..columns].copy_from_slice(&block[..columns]);
            side.bodies[k] = body;
            if level(levels, body) > lowest.max(1) {
                side.gains[k] = LIGHTER;
            }
            let square: f64 = side.rows[k].iter().map(|value| value * value).sum();
            side.stiffness += side.gains[k] * square;
        }
        if side.stiffness > 0.0 {
            side.response = 1.0 / side.stiffness;
        }
        side
    }
}

/// Projected Gauss-Seidel; returns w⁻¹ Ĵ_nᵀ p of each body, √kg m/s, and of one more that stands for all that never move.
///
/// A contact that asks for nothing, of bodies that no other has moved yet, stays as it is.
fn sweep(
    stack: &Stack,
    pairs: &[[u32; 2]],
    levels: &[u32],
    order: &[u32],
    asked: &[f64],
) -> Vec<[f64; 6]> {
    const UNSEEN: u32 = u32::MAX;
    let mut states = vec![[0.0; 6]; levels.len() + 1];
    let mut moved = vec![false; levels.len()];
    // Sides are made when they are visited first, and lie in that order.
    let (mut sides, mut places) = (Vec::new(), vec![UNSEEN; order.len()]);
    let enough = TOLERANCE * TOLERANCE * asked.iter().map(|value| value * value).sum::<f64>();
    for _ in 0..SWEEPS {
        // What the natural map of each contact was when it was visited.
        let mut squares = 0.0;
        for (&contact, place) in order.iter().zip(&mut places) {
            let contact = contact as usize;
            let (pair, asked) = (pairs[contact], asked[contact]);
            let stands = |body: &u32| !moved.get(*body as usize).is_some_and(|moved| *moved);
            if asked <= 0.0 && pair.iter().all(stands) {
                continue;
            }
            if *place == UNSEEN {
                *place = sides.len() as u32;
                sides.push(Side::of(contact, pair, levels, stack));
            }
            let side = &mut sides[*place as usize];
            let [a, b] = side.bodies.map(|body| body as usize);
            let velocity = dot(&side.rows[0], &states[a]) + dot(&side.rows[1], &states[b]);
            let impulse = side.impulse - side.response * (velocity - asked);
            let change = impulse.max(0.0) - side.impulse;
            if change == 0.0 {
                continue;
            }
            side.impulse += change;
            for (k, body) in [a, b].into_iter().enumerate() {
                let gained = side.gains[k] * change;
                for (state, row) in states[body].iter_mut().zip(&side.rows[k]) {
                    *state += row * gained;
                }
                if let Some(moved) = moved.get_mut(body) {
                    *moved = true;
                }
            }
            squares += (side.stiffness * change).powi(2);
        }
        if squares <= enough {
            break;
        }
    }
    states
}

fn dot(x: &[f64; 6], y: &[f64; 6]) -> f64 {
    // Two sums side by side in a register, rather than one whose terms wait for each other.
    let mut sums = [0.0; 2];
    for (x, y) in x.as_chunks::<2>().0.iter().zip(y.as_chunks::<2>().0) {
        (0..2).for_each(|k| sums[k] += x[k] * y[k]);
    }
    sums[0] + sums[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_counted_from_what_never_moves_the_short_way() {
        // 5 is fixed; 0 stands on it, 1 on 0, 2 leans on both 1 and the ground; 3 and 4 touch nothing but each other.
        let pairs = [[1, 2], [3, 4], [0, 5], [0, 1], [2, 5], [2, 5]];
        assert_eq!(levels(&pairs, 5), [1, 2, 1, LOOSE, LOOSE]);
    }

    /// The contacts of a column of so many unit masses on the ground, or in free space.
    fn column(masses: usize, grounded: bool) -> (Vec<[u32; 2]>, Stack) {
        let n = masses as u32;
        let mut pairs: Vec<[u32; 2]> = (1..n).map(|k| [k - 1, k]).collect();
        if grounded {
            // The uppermost contact first: the order of visits is not that of the contacts.
            pairs.push([0, n]);
        }
        pairs.reverse();
        let (mut starts, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
        for pair in &pairs {
            for (&body, sign) in pair.iter().zip([-1.0, 1.0]).filter(|(body, _)| **body < n) {
                columns.push(body);
                let upward = if pair[1] == n { 1.0 } else { sign };
                values.extend([upward, 0.0, 0.0]);
            }
            starts.push(columns.len());
        }
        let mut stack = Stack::default();
        stack.layout.rows = 1;
        stack.layout.columns = 3;
        let size = (1, 3);
        stack.whitened =
            crate::exact::BlockMatrix::new(starts, columns, values, size, masses).unwrap();
        (pairs, stack)
    }

    fn lifted(masses: usize, grounded: bool) -> Vec<f64> {
        let (pairs, stack) = column(masses, grounded);
        let asked = vec![1.0; pairs.len()];
        let levels = levels(&pairs, masses);
        let order = from_below(&pairs, &levels);
        let states = sweep(&stack, &pairs, &levels, &order, &asked);
        states[..masses].iter().map(|state| state[0]).collect()
    }

    #[test]
    fn a_column_of_thirty_is_lifted_as_a_whole() {
        for (k, height) in lifted(30, true).into_iter().enumerate() {
            let least = k as f64 + 1.0;
            assert!((height - least).abs() < 1e-2 * least, "{k}: {height}");
        }
    }

    #[test]
    fn what_holds_on_to_nothing_keeps_its_centre() {
        let heights = lifted(3, false);
        assert!(heights.iter().sum::<f64>().abs() < 1e-12);
        assert!((heights[2] - heights[0] - 2.0).abs() < 1e-3);
    }
}
