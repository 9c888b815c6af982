//! Islands in which nothing closes: no impulse is the answer.
//!
//! Without impulses u = −B. Where every −B_n ≥ 0 (for the convex law: every −B_n ≥ μ‖B_t‖) this satisfies Signorini's
//! condition and any law of friction with p = 0, so that p = 0 is a solution; the solvers, which begin there, find the same
//! one. One contact alone that separates proves nothing: the impulses of its neighbours may push it shut.

use crate::exact::Law;

use super::View;

/// Whether no impulse solves these contacts.
pub fn nothing_closes(view: &View, contacts: &[u32]) -> bool {
    contacts.iter().all(|&contact| {
        let target = view.target(contact);
        let sliding = match view.law {
            Law::Cone => {
                let square: f64 = target[1..].iter().map(|x| x * x).sum();
                view.friction[contact as usize] * square.sqrt()
            }
            Law::Normal | Law::Coulomb => 0.0,
        };
        -target[0] >= sliding
    })
}
