//! The direction in which a sliding contact pushes, followed from sweep to sweep by one Newton step on its angle.
//!
//! On the boundary of the cone p = p_n e with e = (1, μ t), t a unit vector. With f = n for Coulomb's law (u_n = 0) and
//! f = e for the convex cone (p·u = 0), f·(A e p_n + b) = 0 gives p_n = -f·b/(f·A e), and what is left is that u_t is
//! parallel to t. Times f·A e, with t⊥ the unit vector a quarter turn on, that reads
//!
//! G(t) = t⊥·(b_t (f·A e) - (f·b) (A e)_t) = 0,
//!
//! which needs neither a division nor a root. A turn by the angle 2 atan q is rational in q, so t stays a unit vector.

use crate::contact::Contact;
use crate::small_matrix::Vector;

/// Largest turn in one visit, rad: a step that asks for more is left to the exact solution.
const LARGEST_TURN: f64 = 0.1;

/// Unit vector along the friction of the last slide; zero before the first.
#[derive(Clone, Copy, Debug, Default)]
pub struct Heading([f64; 2]);

impl Heading {
    pub fn of<const R: usize>(impulse: &Vector<R>) -> Self {
        if R != 3 {
            return Self::default();
        }
        let (x, y) = (impulse[1], impulse[2]);
        let length = (x * x + y * y).sqrt();
        if length > 0.0 {
            Self([x / length, y / length])
        } else {
            Self::default()
        }
    }

    /// The sliding impulse for b after one Newton step; None where it turns far, or what it finds is no sliding.
    #[inline(always)]
    pub fn follow<const R: usize, const CONVEX: bool>(
        &mut self,
        contact: &Contact<R>,
        b: &Vector<R>,
    ) -> Option<Vector<R>> {
        let [x, y] = self.0;
        let square = x * x + y * y;
        if R != 3 || square == 0.0 {
            return None;
        }
        let (a, friction) = (&contact.block, contact.friction);
        // f = (1, ν t)
        let nu = if CONVEX { friction } else { 0.0 };
        let across = |v: [f64; 2]| x * v[1] - y * v[0];
        let along = |v: [f64; 2]| x * v[0] + y * v[1];
        let normal = [a[0][1], a[0][2]];
        let turned = [a[1][1] * x + a[1][2] * y, a[1][2] * x + a[2][2] * y];
        // t⊥·A_tt t⊥, from the trace
        let stiffness = a[1][1] + a[2][2] - along(turned);
        let tangent = [
            normal[0] + friction * turned[0],
            normal[1] + friction * turned[1],
        ];
        let b_t = [b[1], b[2]];
        let (b_along, b_across) = (along(b_t), across(b_t));
        let (e_along, e_across) = (along(tangent), across(tangent));
        let resistance = a[0][0] + friction * along(normal) + nu * e_along;
        let push = b[0] + nu * b_along;
        // u_t times the resistance, along t and across it
        let slip = b_along * resistance - push * e_along;
        let error = b_across * resistance - push * e_across;
        let resistance_slope =
            friction * across(normal) + nu * (e_across + friction * across(turned));
        let slope =
            b_across * (resistance_slope - nu * e_across) - push * friction * stiffness - slip;
        let half_turn = -0.5 * error / slope;
        if !(slope > 0.0 && slip <= 0.0 && half_turn.abs() <= 0.5 * LARGEST_TURN) {
            return None;
        }
        // The new t, times 1 + q².
        let (size, keep) = (1.0 + half_turn * half_turn, 1.0 - half_turn * half_turn);
        let turn = 2.0 * half_turn;
        let direction = [keep * x - turn * y, keep * y + turn * x];
        let ray = [size, friction * direction[0], friction * direction[1]];
        let dot = |x: [f64; 3], y: [f64; 3]| x[0] * y[0] + x[1] * y[1] + x[2] * y[2];
        let first = dot([a[0][0], a[0][1], a[0][2]], ray);
        let (resistance, push) = if CONVEX {
            let rest = ray[1] * dot([a[1][0], a[1][1], a[1][2]], ray)
                + ray[2] * dot([a[2][0], a[2][1], a[2][2]], ray);
            (size * first + rest, dot(ray, [b[0], b[1], b[2]]))
        } else {
            (first, b[0])
        };
        let factor = -push / resistance;
        let mut impulse = [0.0; R];
        for r in 0..R {
            impulse[r] = factor * ray[r];
        }
        // The length is one but for rounding, which this keeps from adding up.
        let unit = (1.5 - 0.5 * square) / size;
        self.0 = direction.map(|value| unit * value);
        (factor >= 0.0 && impulse.iter().all(|value| value.is_finite())).then_some(impulse)
    }
}

#[cfg(test)]
mod tests {
    use crate::contact::samples::Uniform;
    use crate::contact::{Contact, Law};
    use crate::friction_cone::{ConvexCone, Coulomb};
    use crate::small_matrix::Vector;

    /// How far from the exact slide one step ends that starts from a slide with a velocity `shift` m/s away, at most.
    fn worst_error<L: Law<3>>(law: &L, shift: f64) -> f64 {
        let mut random = Uniform(8);
        let mut worst = 0.0f64;
        let mut followed = 0;
        for _ in 0..1000 {
            let block = random.block::<3>(0.2);
            let scale = block[0][0];
            let contact = Contact::new(&block, [0.0; 3], 0.3, scale);
            let mut b: Vector<3> = random.vector();
            // Fast enough to slide.
            b[0] = -0.1 - b[0].abs();
            b[1] += 3.0f64.copysign(b[1]);
            let mut local = law.prepare(&contact);
            law.slide(&contact, &mut local, &b).unwrap();
            for value in &mut b {
                *value += shift * random.draw();
            }
            let exact = law.slide(&contact, &mut law.prepare(&contact), &b).unwrap();
            if let Some(found) = law.slide_on(&contact, &mut local, &b) {
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
                worst_error(&Coulomb, shift),
                worst_error(&ConvexCone, shift),
            ] {
                assert!(worst < 1e-11 + 10.0 * shift * shift, "{worst} at {shift}");
            }
        }
    }
}
