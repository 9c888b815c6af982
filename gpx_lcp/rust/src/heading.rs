//! The direction in which a sliding contact pushes, followed from sweep to sweep by a Newton step on its angle, or found by
//! some.
//!
//! On the boundary of the cone p = p_n e with e = (1, μ t), t a unit vector. With f = n for Coulomb's law (u_n = 0) and
//! f = e for the convex cone (p·u = 0), f·(A e p_n + b) = 0 gives p_n = -f·b/(f·A e), and what is left is that u_t is
//! parallel to t. Times f·A e, with t⊥ the unit vector a quarter turn on, that reads
//!
//! G(t) = t⊥·(b_t (f·A e) - (f·b) (A e)_t) = 0,
//!
//! which needs neither a division nor a root. A turn by the angle 2 atan q is rational in q, so t stays a unit vector.

use crate::contact::Contact;
use crate::lanes::Lanes;
use crate::small_matrix::tangent_length;

/// Largest turn of the last step, rad, which leaves the square of it: of a heading that is followed, and of a first one,
/// which is found to rounding.
const LAST_TURN: f64 = 0.02;
const LAST_OF_FIRST: f64 = 1e-8;
/// Steps, at most, before the exact solution is called for.
const STEPS: usize = 6;
/// No step goes further than to this q: its slope is that of where it begins.
const FARTHEST: f64 = 0.5;

/// The sliding impulse for b, and where it is one: not where the steps find none, or no sliding. With one tangent there are
/// two directions to slide in, and it is one where exactly one of them does.
///
/// The heading follows where it is one. As a rule one step is all; more are taken for lanes that are wanted, bit by bit.
#[inline(always)]
pub fn follow<V: Lanes, const R: usize, const CONVEX: bool>(
    contact: &mut Contact<V::Memory, R>,
    b: &[V; R],
    wanted: u32,
) -> ([V; R], V::Mask) {
    let zero = V::splat(0.0);
    if R == 2 {
        return one_of_two::<V, R, CONVEX>(contact, b);
    }
    if R != 3 {
        return (*b, V::splat(-1.0).at_least(zero));
    }
    let mut a = [[zero; 3]; 3];
    for r in 0..3 {
        for c in 0..3 {
            a[r][c] = V::load(contact.block_at(r, c));
        }
    }
    let before = [V::load(&contact.heading[0]), V::load(&contact.heading[1])];
    let [mut x, mut y] = before;
    let has_slid = (x * x + y * y).at_least(V::splat(0.5));
    if V::bits(has_slid) & wanted != wanted {
        // At first, against the velocity that there is without the impulse.
        let speed = tangent_length(b);
        x = (-b[1] / speed).replaced(has_slid, x);
        y = (-b[2] / speed).replaced(has_slid, y);
    }
    let friction = V::load(&contact.friction);
    // f = (1, ν t)
    let nu = if CONVEX { friction } else { zero };
    let last = V::splat(0.5 * LAST_OF_FIRST).replaced(has_slid, V::splat(0.5 * LAST_TURN));
    let mut impulse = *b;
    let mut step = 1;
    loop {
        let turned = [two(a[1][1], x, a[1][2], y), two(a[1][2], x, a[2][2], y)];
        // t⊥·A_tt t⊥, from the trace
        let stiffness = a[1][1] + a[2][2] - two(x, turned[0], y, turned[1]);
        let tangent = [
            a[0][1].plus_product(friction, turned[0]),
            a[0][2].plus_product(friction, turned[1]),
        ];
        let (b_along, b_across) = (two(x, b[1], y, b[2]), two(x, b[2], -y, b[1]));
        let e_along = two(x, tangent[0], y, tangent[1]);
        let e_across = two(x, tangent[1], -y, tangent[0]);
        let resistance = a[0][0]
            .plus_product(friction, two(x, a[0][1], y, a[0][2]))
            .plus_product(nu, e_along);
        let push = b[0].plus_product(nu, b_along);
        // u_t times the resistance, along t and across it
        let slip = two(b_along, resistance, -push, e_along);
        let error = two(b_across, resistance, -push, e_across);
        let turned_across = two(x, turned[1], -y, turned[0]);
        let resistance_slope =
            friction * two(x, a[0][2], -y, a[0][1]) + nu * friction * turned_across;
        let slope = two(b_across, resistance_slope, -push, friction * stiffness) - slip;
        // q is e/slope. The new t, and its ray in the cone, times slope² + e²: what follows does not wait for a division.
        let e = V::splat(-0.5) * error;
        let rises = slope.at_least(V::splat(f64::MIN_POSITIVE));
        let (size, direction) = turned_by(e, slope, x, y);
        let ray = [size, friction * direction[0], friction * direction[1]];
        let first = two(a[0][0], ray[0], a[0][1], ray[1]).plus_product(a[0][2], ray[2]);
        let (resistance, push) = if CONVEX {
            let second = two(a[1][0], ray[0], a[1][1], ray[1]).plus_product(a[1][2], ray[2]);
            let third = two(a[2][0], ray[0], a[2][1], ray[1]).plus_product(a[2][2], ray[2]);
            (
                two(ray[0], first, ray[1], second).plus_product(ray[2], third),
                two(ray[0], b[0], ray[1], b[1]).plus_product(ray[2], b[2]),
            )
        } else {
            (first, b[0])
        };
        let factor = -push / resistance;
        let mut follows = V::both(rises, factor.at_least(zero));
        for r in 0..3 {
            impulse[r] = factor * ray[r];
            follows = V::both(follows, impulse[r].finite());
        }
        let bound = last * slope;
        for holds in [zero.at_least(slip), bound.at_least(e), e.at_least(-bound)] {
            follows = V::both(follows, holds);
        }
        if step == STEPS || wanted & V::bits(rises) & !V::bits(follows) == 0 {
            // The length is one but for rounding, which this keeps from adding up.
            let unit = (V::splat(1.5) - V::splat(0.5) * two(x, x, y, y)) / size;
            for k in 0..2 {
                before[k]
                    .replaced(follows, unit * direction[k])
                    .store(&mut contact.heading[k]);
            }
            return (impulse, follows);
        }
        let most = V::splat(FARTHEST) * slope;
        let e = e.replaced(e.at_least(most), most);
        let e = e.replaced((-most).at_least(e), -most);
        let (size, direction) = turned_by(e, slope, x, y);
        x = x.replaced(rises, direction[0] / size);
        y = y.replaced(rises, direction[1] / size);
        step += 1;
    }
}

/// a b + c d
#[inline(always)]
fn two<V: Lanes>(a: V, b: V, c: V, d: V) -> V {
    (a * b).plus_product(c, d)
}

/// (x, y) turned by the angle 2 atan e/s, times e² + s², and that.
#[inline(always)]
fn turned_by<V: Lanes>(e: V, s: V, x: V, y: V) -> (V, [V; 2]) {
    let (square, keep) = (two(s, s, e, e), two(s, s, -e, e));
    let turn = (e + e) * s;
    (square, [two(keep, x, -turn, y), two(keep, y, turn, x)])
}

/// The same with one tangent: p = p_n (1, ±μ) slides against ±t where p_n ≥ 0 and ±u_t ≤ 0.
#[inline(always)]
fn one_of_two<V: Lanes, const R: usize, const CONVEX: bool>(
    contact: &Contact<V::Memory, R>,
    b: &[V; R],
) -> ([V; R], V::Mask) {
    let (zero, one) = (V::splat(0.0), V::splat(1.0));
    let entry = |r: usize, c: usize| V::load(contact.block_at(r, c));
    let friction = V::load(&contact.friction);
    let mut impulse = *b;
    let mut ways = zero;
    for side in [one, -one] {
        let along = side * friction;
        let pushed = [
            entry(0, 0) + entry(0, 1) * along,
            entry(1, 0) + entry(1, 1) * along,
        ];
        let nu = if CONVEX { along } else { zero };
        let (resistance, push) = (pushed[0] + nu * pushed[1], b[0] + nu * b[1]);
        let factor = -push / resistance;
        // u_t times the resistance.
        let slip = side * (b[1] * resistance - push * pushed[1]);
        let mut slides = factor.finite();
        for holds in [
            resistance.at_least(V::splat(f64::MIN_POSITIVE)),
            factor.at_least(zero),
            zero.at_least(slip),
        ] {
            slides = V::both(slides, holds);
        }
        impulse[0] = impulse[0].replaced(slides, factor);
        impulse[1] = impulse[1].replaced(slides, factor * along);
        ways = ways + zero.replaced(slides, one);
    }
    let follows = V::both(ways.at_least(one), one.at_least(ways));
    (impulse, follows)
}

#[cfg(test)]
mod tests {
    use crate::contact::samples::Uniform;
    use crate::contact::{Contact, Law};
    use crate::friction_cone::{ConvexCone, Coulomb};
    use crate::small_matrix::Vector;

    use super::LAST_TURN;

    /// How far from the exact slide a slide is found, at most, that follows one of which b was `shift` m/s away, and b_t
    /// `turn` rad; or the first one.
    fn worst_error<L: Law<3>>(law: &L, moved: Option<(f64, f64)>) -> f64 {
        let mut random = Uniform(8);
        let mut worst = 0.0f64;
        let mut followed = 0;
        for _ in 0..1000 {
            let block = random.block::<3>(0.2);
            let scale = block[0][0];
            let mut contact = Contact::new(&block, [0.0; 3], 0.3, scale);
            let mut b: Vector<3> = random.vector();
            // Fast enough to slide.
            b[0] = -0.1 - b[0].abs();
            b[1] += 3.0f64.copysign(b[1]);
            if let Some((shift, turn)) = moved {
                let found = law.slide(&contact, &mut L::Local::default(), &b).unwrap();
                let length = found[1].hypot(found[2]);
                contact.heading = [found[1] / length, found[2] / length];
                for value in &mut b {
                    *value += shift * random.draw();
                }
                let (sin, cos) = turn.sin_cos();
                (b[1], b[2]) = (cos * b[1] - sin * b[2], sin * b[1] + cos * b[2]);
            }
            let exact = law.slide(&contact, &mut L::Local::default(), &b).unwrap();
            let (found, follows) = law.slide_on::<f64>(&mut contact, &[], &b, 1);
            if follows {
                followed += 1;
                for r in 0..3 {
                    worst = worst.max((found[r] - exact[r]).abs() / exact[0]);
                }
            }
        }
        assert!(followed > 900, "only {followed} were followed");
        worst
    }

    #[test]
    fn one_step_leaves_the_square_of_the_distance() {
        for shift in [0.0, 1e-6, 1e-3] {
            for worst in [
                worst_error(&Coulomb, Some((shift, 0.0))),
                worst_error(&ConvexCone, Some((shift, 0.0))),
            ] {
                assert!(worst < 1e-11 + 10.0 * shift * shift, "{worst} at {shift}");
            }
        }
    }

    #[test]
    fn what_turns_far_is_found_as_well_as_what_turns_little() {
        for turn in [0.1, -0.5, 1.0] {
            for worst in [
                worst_error(&Coulomb, Some((0.0, turn))),
                worst_error(&ConvexCone, Some((0.0, turn))),
            ] {
                assert!(worst < 10.0 * LAST_TURN.powi(2), "{worst} at {turn}");
            }
        }
    }

    #[test]
    fn the_first_slide_is_found_to_rounding() {
        for worst in [worst_error(&Coulomb, None), worst_error(&ConvexCone, None)] {
            assert!(worst < 1e-10, "{worst}");
        }
    }

    /// How far from the exact slide a contact with one tangent ends.
    fn worst_of_two<L: Law<2>>(law: &L) -> f64 {
        let mut random = Uniform(9);
        let mut worst = 0.0f64;
        let mut followed = 0;
        for _ in 0..1000 {
            let block = random.block::<2>(0.2);
            let mut contact = Contact::new(&block, [0.0; 2], 0.3, block[0][0]);
            let mut b: Vector<2> = random.vector();
            // Fast enough to slide.
            b[0] = -0.1 - b[0].abs();
            b[1] += 3.0f64.copysign(b[1]);
            let exact = law.slide(&contact, &mut L::Local::default(), &b).unwrap();
            let (found, follows) = law.slide_on::<f64>(&mut contact, &[], &b, 1);
            if follows {
                followed += 1;
                for r in 0..2 {
                    worst = worst.max((found[r] - exact[r]).abs() / exact[0]);
                }
            }
        }
        assert!(followed > 900, "only {followed} were followed");
        worst
    }

    #[test]
    fn with_one_tangent_a_slide_is_exact() {
        assert!(worst_of_two(&Coulomb) < 1e-10);
        assert!(worst_of_two(&ConvexCone) < 1e-10);
    }

    #[test]
    fn what_sticks_or_jams_is_left_to_the_exact_solution() {
        let mut contact = Contact::new(&[[1.0, 0.0], [0.0, 1.0]], [0.0; 2], 0.5, 1.0);
        let slide = |contact: &mut Contact<f64, 2>, b| Coulomb.slide_on::<f64>(contact, &[], &b, 1);
        assert_eq!(slide(&mut contact, [-1.0, 2.0]), ([1.0, -0.5], true));
        assert!(!slide(&mut contact, [-1.0, 0.1]).1, "it sticks");
        // Painlevé: sliding one way, friction would press the contact on harder than its load does.
        let mut steep = Contact::new(&[[1.0, 2.0], [2.0, 5.0]], [0.0; 2], 1.0, 5.0);
        assert!(!slide(&mut steep, [-1.0, 0.0]).1, "it jams");
    }
}
