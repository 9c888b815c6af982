//! The bodies of a world, from Python's arrays.

use std::panic::catch_unwind;
use std::sync::Arc;

use parry3d_f64::math::{Matrix, Pose, Vector};
use pyo3::prelude::*;

use super::records::{Floats, ProblemError, Table, pose, rows, same_length};
use crate::bodies::{Bodies as BodyData, CombineRule, Material, root};
use crate::collision::solid::{Convex, Solid};

/// The bodies of a world: what does not change while it runs.
#[pyclass(frozen, module = "gpx_lcp._core")]
pub struct Bodies(pub Arc<BodyData>);

#[pymethods]
impl Bodies {
    /// Shapes are pairs of a kind and its numbers: "none", "sphere" (radius), "half_space" (normal), "box" (half
    /// lengths), "capsule" and "cylinder" (radius, half length), "hull" (points).
    #[new]
    fn new(
        moving: usize,
        shapes: Vec<(String, Floats<'_>)>,
        materials: Vec<(f64, usize, [f64; 2], usize)>,
        masses: Floats<'_>,
        inertias: Table<'_>,
        fixed_poses: Table<'_>,
    ) -> PyResult<Self> {
        let solids = shapes
            .iter()
            .enumerate()
            .map(|(body, (kind, numbers))| solid(body, kind, numbers.as_slice()?))
            .collect::<PyResult<Vec<_>>>()?;
        let materials = materials
            .into_iter()
            .map(|(friction, friction_rule, elasticity, elasticity_rule)| {
                Ok(Material {
                    friction,
                    friction_rule: combine_rule(friction_rule)?,
                    elasticity,
                    elasticity_rule: combine_rule(elasticity_rule)?,
                })
            })
            .collect::<PyResult<Vec<_>>>()?;
        let masses = masses.as_slice()?.to_vec();
        let inertias: Vec<Matrix> = rows::<f64, 9>(&inertias)?
            .iter()
            .map(Matrix::from_cols_array)
            .collect();
        let fixed_poses: Vec<Pose> = rows::<f64, 7>(&fixed_poses)?.iter().map(pose).collect();
        same_length("masses", masses.len(), moving)?;
        same_length("inertias", inertias.len(), moving)?;
        same_length("materials", materials.len(), solids.len())?;
        same_length("shapes", solids.len(), moving + fixed_poses.len())?;
        let inverse = |tensor: &Matrix| {
            if *tensor == Matrix::ZERO {
                Matrix::ZERO
            } else {
                tensor.inverse()
            }
        };
        Ok(Bodies(Arc::new(BodyData {
            moving,
            solids,
            materials,
            inverse_inertia_roots: inertias
                .iter()
                .map(|tensor| root(&inverse(tensor)))
                .collect(),
            inverse_inertias: inertias.iter().map(inverse).collect(),
            masses,
            inertias,
            fixed_poses,
        })))
    }

    fn __repr__(&self) -> String {
        let (all, moving) = (self.0.len(), self.0.moving);
        format!("Bodies({moving} moving, {} fixed)", all - moving)
    }
}

fn solid(body: usize, kind: &str, numbers: &[f64]) -> PyResult<Option<Solid>> {
    let convex = |convex| Ok(Some(Solid::Convex(convex)));
    match (kind, numbers) {
        ("none", []) => Ok(None),
        ("sphere", &[radius]) => Ok(Some(Solid::Sphere { radius })),
        ("half_space", &[x, y, z]) => Ok(Some(Solid::HalfSpace {
            normal: Vector::new(x, y, z),
        })),
        ("box", &[x, y, z]) => convex(Convex::cuboid(Vector::new(x, y, z))),
        ("capsule", &[radius, half_length]) => convex(Convex::capsule(radius, half_length)),
        ("cylinder", &[radius, half_length]) => convex(Convex::cylinder(radius, half_length)),
        ("hull", points) => {
            let points: Vec<Vector> = points.chunks_exact(3).map(Vector::from_slice).collect();
            let hull = catch_unwind(|| Convex::hull(&points)).unwrap_or(None);
            hull.map(|hull| Some(Solid::Convex(hull))).ok_or_else(|| {
                ProblemError::new_err(format!("the points of body {body} have no convex hull"))
            })
        }
        _ => Err(ProblemError::new_err(format!(
            "body {body} has a shape of kind {kind:?} with {} numbers, which does not exist",
            numbers.len()
        ))),
    }
}

fn combine_rule(index: usize) -> PyResult<CombineRule> {
    CombineRule::from_index(index)
        .ok_or_else(|| ProblemError::new_err(format!("there is no combine rule {index}")))
}
