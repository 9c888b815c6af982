//! Block Gauss-Seidel on a stacked system: picks the kernel that fits the rows, the bodies and the law.

use std::array::from_fn;
use std::borrow::Cow;
use std::time::Instant;

use crate::contact::Law;
use crate::delassus::{BlockRows, Delassus};
use crate::exact::{BlockMatrix, largest};
use crate::explicit::Explicit;
use crate::factored::{Blocks, Factored, Source};
use crate::friction_cone::{ConvexCone, Coulomb};
use crate::gauss_seidel::{History, Outcome, Problem, Settings, Stop, solve_while};
use crate::presolve::Form;
use crate::program::Program;
use crate::small_matrix::Vector;
use crate::solving::{Answer, Details, Interrupted, Status, System};

/// The most velocities of a body that has a kernel.
const WIDEST: usize = 6;

/// Sweeps before the first look at the impulses; each further look comes when their number has doubled.
const FIRST_LOOK: usize = 160;

/// Who looks at the impulses, rows per contact, now and then, and says whether to go on.
pub type Look<'a> = &'a dyn Fn(&[f64]) -> bool;

/// Sweep over the contacts of a system; None where the caller interrupts it.
///
/// Contacts that touch more than two bodies are swept on A, and so are bodies of more than six velocities.
pub fn sweep(
    system: System,
    program: &Program,
    settings: &Settings,
    start: Option<&[f64]>,
    interrupted: Interrupted,
    look: Option<Look>,
) -> Option<Answer> {
    let delassus;
    let mut system = system;
    if system.form == Form::Velocity && !is_swept_by_bodies(system.matrix) {
        delassus = system.matrix.times_its_transpose();
        (system.form, system.matrix) = (Form::Impulse, &delassus);
    }
    let question = Question {
        system,
        frictionless: *program == Program::Normal || system.matrix.height == 1,
        settings,
        start,
        interrupted,
        look,
    };
    let rows = if question.frictionless {
        1
    } else {
        system.matrix.height
    };
    match (system.form, rows, system.matrix.width) {
        (Form::Velocity, 1, 1) => question.factored::<1, 1, _, _>(&Coulomb, Blocks),
        (Form::Velocity, 1, 2) => question.factored::<1, 2, _, _>(&Coulomb, Blocks),
        (Form::Velocity, 1, 3) => question.factored::<1, 3, _, _>(&Coulomb, Blocks),
        (Form::Velocity, 1, _) => question.factored::<1, WIDEST, _, _>(&Coulomb, Blocks),
        (Form::Velocity, 2, 1 | 2) => question.factored_by::<2, 2>(program, Blocks),
        (Form::Velocity, 2, 3) => question.factored_by::<2, 3>(program, Blocks),
        (Form::Velocity, 2, _) => question.factored_by::<2, WIDEST>(program, Blocks),
        (Form::Velocity, _, 1..=3) => question.factored_by::<3, 3>(program, Blocks),
        (Form::Velocity, ..) => match system.rigid {
            Some(rigid) => question.factored_by::<3, WIDEST>(program, rigid),
            None => question.factored_by::<3, WIDEST>(program, Blocks),
        },
        (Form::Impulse, 1, _) => question.explicit::<1, _>(&Coulomb),
        (Form::Impulse, 2, _) => question.explicit_by::<2>(program),
        (Form::Impulse, ..) => question.explicit_by::<3>(program),
    }
}

fn is_swept_by_bodies(matrix: &BlockMatrix) -> bool {
    let mut contacts = matrix.starts.windows(2);
    matrix.width <= WIDEST && contacts.all(|range| range[1] - range[0] <= 2)
}

struct Question<'a> {
    system: System<'a>,
    /// The normal row of each contact is all that counts.
    frictionless: bool,
    settings: &'a Settings,
    start: Option<&'a [f64]>,
    interrupted: Interrupted<'a>,
    look: Option<Look<'a>>,
}

impl Question<'_> {
    fn factored_by<const R: usize, const D: usize>(
        &self,
        program: &Program,
        source: impl Source<R, D>,
    ) -> Option<Answer> {
        match program {
            Program::Cone => self.factored::<R, D, _, _>(&ConvexCone, source),
            Program::Polygon(corners) => {
                self.factored::<R, D, _, _>(&Program::polygon(corners), source)
            }
            _ => self.factored::<R, D, _, _>(&Coulomb, source),
        }
    }

    fn explicit_by<const R: usize>(&self, program: &Program) -> Option<Answer> {
        match program {
            Program::Cone => self.explicit::<R, _>(&ConvexCone),
            Program::Polygon(corners) => self.explicit::<R, _>(&Program::polygon(corners)),
            _ => self.explicit::<R, _>(&Coulomb),
        }
    }

    /// On Ĵ, with bodies of D velocities, filled up with zeros where they have fewer.
    fn factored<const R: usize, const D: usize, L: Law<R>, S: Source<R, D>>(
        &self,
        law: &L,
        source: S,
    ) -> Option<Answer> {
        let begun = Instant::now();
        let matrix = match self.system.matrix {
            matrix if matrix.width == D => Cow::Borrowed(matrix),
            matrix => Cow::Owned(matrix.widened(D)),
        };
        let delassus = Factored::<R, D, S>::new(&matrix, source);
        let delassus = delassus.expect("contacts of more bodies are swept on A");
        self.sweep(begun, &delassus, law)
    }

    fn explicit<const R: usize, L: Law<R>>(&self, law: &L) -> Option<Answer> {
        let begun = Instant::now();
        let delassus = Explicit::<R>::new(BlockRows::of(self.system.matrix));
        self.sweep(begun, &delassus, law)
    }

    /// Sweep over the first R rows of each contact.
    fn sweep<const R: usize, L: Law<R>>(
        &self,
        begun: Instant,
        delassus: &impl Delassus<R>,
        law: &L,
    ) -> Option<Answer> {
        let System {
            b, friction, scale, ..
        } = self.system;
        let (rows, contacts) = (self.system.matrix.height, friction.len());
        // p is proportional to B. A power of two changes no digit, and keeps squares of tiny or huge velocities finite.
        let unit = power_of_two_above(largest(b));
        let first_rows = |values: &[f64]| -> Vec<Vector<R>> {
            let contacts = values.chunks_exact(rows);
            contacts.map(|row| from_fn(|r| row[r] / unit)).collect()
        };
        let target = first_rows(b);
        let start = self
            .start
            .map_or_else(|| vec![[0.0; R]; contacts], first_rows);
        let none = if self.frictionless {
            vec![0.0; contacts]
        } else {
            Vec::new()
        };
        let square: f64 = b.iter().map(|value| (value / unit) * (value / unit)).sum();
        let problem = Problem {
            target: &target,
            friction: if self.frictionless { &none } else { friction },
            scale,
            target_norm: square.sqrt(),
        };
        let in_full = |impulses: &[Vector<R>]| {
            let mut impulse = vec![0.0; b.len()];
            for (all, p) in impulse.chunks_exact_mut(rows).zip(impulses) {
                for r in 0..R {
                    all[r] = unit * p[r];
                }
            }
            impulse
        };
        let go_on = &mut || !(self.interrupted)();
        let (mut next_look, mut ended) = (FIRST_LOOK, false);
        let promising = &mut |history: &History, impulses: &dyn Fn() -> Vec<Vector<R>>| {
            let sweeps = history.last().map_or(0, |&(sweeps, _)| sweeps);
            if sweeps >= next_look
                && let Some(look) = self.look
            {
                next_look = 2 * sweeps;
                ended = !look(&in_full(&impulses()));
            }
            !ended
        };
        let settings = self.settings;
        let outcome = solve_while(delassus, law, &problem, &start, settings, go_on, promising);
        let Outcome {
            mut stop,
            sweeps,
            history,
            elapsed,
            ..
        } = outcome;
        if ended {
            stop = Stop::MaxSweeps;
        } else if stop == Stop::Interrupted {
            return None;
        }
        let impulse = in_full(&outcome.impulse);
        Some(Answer {
            impulse,
            status: stop.into(),
            residual: history.last().map_or(0.0, |(_, residual)| *residual),
            iterations: sweeps,
            setup: begun.elapsed().saturating_sub(elapsed),
            elapsed,
            history,
            details: Details::Sweeps(stop),
            ..Answer::default()
        })
    }
}

impl From<Stop> for Status {
    fn from(stop: Stop) -> Self {
        match stop {
            Stop::Solved => Status::Solved,
            Stop::MaxSweeps | Stop::TimeLimit | Stop::Interrupted => Status::MaxIterations,
            Stop::Stalled => Status::Stalled,
            Stop::NumericalError => Status::NumericalError,
        }
    }
}

/// The power of two just above a positive number.
fn power_of_two_above(value: f64) -> f64 {
    let exponent = (value.to_bits() >> 52 & 0x7ff) as i32 - 1022;
    2.0_f64.powi(exponent)
}
