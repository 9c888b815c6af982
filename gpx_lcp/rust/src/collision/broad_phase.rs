//! Which pairs of bodies may touch: the broad phase.
//!
//! Every body's box is kept somewhat wider than it need be. As long as the bodies stay inside these wide boxes, the pairs of
//! wide boxes that meet hold every pair that can touch, and each step only tries their true boxes; when one leaves, all
//! are found anew by parry's bounding-volume hierarchy. What comes out depends on the true boxes alone: memory saves
//! time, and changes no result.

use parry3d_f64::bounding_volume::{Aabb, BoundingVolume};
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy, BvhWorkspace};

use crate::bodies::Bodies;

/// Up to so many bodies every pair is tried: the tree takes longer to build.
const TREE_FROM: usize = 64;
/// How much wider a wide box is than the true one: this share of the body's size, and so many times its travel in a step.
const WIDER: f64 = 0.1;
const STEPS: f64 = 4.0;

/// What is remembered from one step to the next.
#[derive(Default)]
pub struct BroadPhase {
    /// None for bodies without shape or without bounds.
    wide: Vec<Option<Aabb>>,
    /// Pairs of wide boxes that meet and of planes with anything that moves, the later body second, ascending.
    near: Vec<[u32; 2]>,
    boxes: Vec<Option<Aabb>>,
    /// Those of the near pairs whose true boxes meet now.
    meeting: Vec<[u32; 2]>,
}

impl BroadPhase {
    /// The pairs whose boxes meet, at least one of them moving, ascending by the second body; `bounds` gives the box of a
    /// body, as much wider as it can travel in the step, its margin.
    pub fn pairs(
        &mut self,
        bodies: &Bodies,
        margins: &[f64],
        bounds: impl Fn(usize) -> Option<Aabb>,
    ) -> &[[u32; 2]] {
        self.boxes.clear();
        self.boxes.extend((0..bodies.len()).map(bounds));
        let holds = |(wide, true_box): (&Option<Aabb>, &Option<Aabb>)| match (wide, true_box) {
            (Some(wide), Some(true_box)) => wide.contains(true_box),
            (wide, true_box) => wide.is_none() && true_box.is_none(),
        };
        if self.wide.len() != self.boxes.len() || !self.wide.iter().zip(&self.boxes).all(holds) {
            self.find(bodies, margins);
        }
        let boxes = &self.boxes;
        let meet = |[a, b]: &&[u32; 2]| match (&boxes[*a as usize], &boxes[*b as usize]) {
            (Some(one), Some(other)) => one.intersects(other),
            _ => true,
        };
        self.meeting.clear();
        self.meeting.extend(self.near.iter().filter(meet));
        &self.meeting
    }

    /// Makes the wide boxes anew, and finds the pairs of them that meet.
    fn find(&mut self, bodies: &Bodies, margins: &[f64]) {
        // Set at the end: whatever goes wrong before leaves nothing that looks valid.
        self.wide.clear();
        let boxes = self.boxes.iter().enumerate();
        let widened = boxes.map(|(body, true_box)| {
            let wider = WIDER * bodies.bound(body) + STEPS * margins[body];
            true_box.map(|true_box| true_box.loosened(wider))
        });
        let wide: Vec<Option<Aabb>> = widened.collect();
        let (near, moving) = (&mut self.near, bodies.moving);
        near.clear();
        let bounded = |body: usize| wide[body].map(|aabb| (body, aabb));
        let bounded: Vec<(usize, Aabb)> = (0..bodies.len()).filter_map(bounded).collect();
        for plane in (0..bodies.len()).filter(|&body| bodies.has_no_bounds(body)) {
            let others = bounded.iter().filter(|(body, _)| *body < moving);
            near.extend(others.map(|(body, _)| [plane as u32, *body as u32]));
        }
        let mut found = |one: usize, other: usize| {
            let (low, high) = (one.min(other) as u32, one.max(other) as u32);
            if (high as usize) < moving {
                near.push([low, high]);
            } else if (low as usize) < moving {
                near.push([high, low]);
            }
        };
        if bounded.len() <= TREE_FROM {
            for (place, (one, aabb)) in bounded.iter().enumerate() {
                for (other, other_aabb) in &bounded[place + 1..] {
                    if aabb.intersects(other_aabb) {
                        found(*one, *other);
                    }
                }
            }
        } else {
            // Leaves are numbered from 0 without holes: parry's build relies on that.
            let leaves = bounded.iter().map(|(_, aabb)| *aabb).enumerate();
            let tree = Bvh::from_iter(BvhBuildStrategy::Binned, leaves);
            let workspace = &mut BvhWorkspace::default();
            tree.traverse_bvtt_single_tree::<false>(workspace, &mut |one, other| {
                found(bounded[one as usize].0, bounded[other as usize].0);
            });
        }
        // The moving body first in the order, so that contacts of one body stand together.
        near.sort_unstable_by_key(|&[a, b]| (b, a));
        self.wide = wide;
    }
}
